/* A square lattice in a cloud of dots: which dot is which, and the map from places in the lattice to those of the dots. */
#include "rig/develop/lattice.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { DOTS_NEEDED = 9, UNKNOWN = -1 };

/* A neighbour is looked for within this share of the spacing around where the last step would put it. */
static const double reach_share = 0.25;

/* The middle dot's nearest neighbour may be that much farther or nearer than is usual: half of the 41 % to the diagonal one,
 * which would be taken for it where all four between are lost. */
static const double usual_share = 0.2;

/* Beyond these a lattice is not square: one of triangles has a cosine of 0.5, and points that are 25 % longer than wide no
 * projector has. */
static const double square_cosine = 0.25;
static const double square_ratio = 1.25;

/* Robust deviations beyond which a dot is not of the lattice, and the distance, in spacings, that never is too far. */
static const double reject_deviations = 4;
static const double reject_floor = 1e-3;

/* A dot on its way into the lattice: where it is, and how its neighbours are thought to lie. */
struct node {
    bool known;
    int column, row;
    struct point across, down;
};

static struct point minus(struct point a, struct point b)
{
    return (struct point){a.x - b.x, a.y - b.y};
}

static double length(struct point v)
{
    return hypot(v.x, v.y);
}

/* The dot nearest to a place, within reach; UNKNOWN where there is none. `but` is left out. */
static long nearest(const struct point *dots, size_t count, struct point place, double reach,
                    long but)
{
    long found = UNKNOWN;
    for (size_t i = 0; i < count; i++) {
        double distance = length(minus(dots[i], place));
        if ((long)i != but && distance < reach) {
            reach = distance;
            found = (long)i;
        }
    }
    return found;
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a;
    double y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The dot nearest to the middle of those whose neighbours are as near as is usual. `gaps` holds 2 count. */
static long find_start(const struct point *dots, size_t count, double *gaps)
{
    struct point middle = {0, 0};
    double *sorted = gaps + count;
    double least = INFINITY;
    long found = 0;
    for (size_t i = 0; i < count; i++) {
        middle.x += dots[i].x / (double)count;
        middle.y += dots[i].y / (double)count;
        gaps[i] = length(minus(dots[nearest(dots, count, dots[i], INFINITY, (long)i)], dots[i]));
    }
    memcpy(sorted, gaps, count * sizeof *sorted);
    qsort(sorted, count, sizeof *sorted, compare_doubles);
    for (size_t i = 0; i < count; i++) {
        double distance = length(minus(dots[i], middle));
        if (fabs(gaps[i] / sorted[count / 2] - 1) < usual_share && distance < least) {
            least = distance;
            found = (long)i;
        }
    }
    return found;
}

/* Two neighbours of the dot that lie across each other: the nearest, and of those about as far the squarest. */
static bool find_basis(const struct point *dots, size_t count, long start, struct node *node)
{
    long first = nearest(dots, count, dots[start], INFINITY, start);
    struct point across = minus(dots[first], dots[start]);
    double squarest = 0.5;
    bool found = false;
    for (size_t i = 0; i < count; i++) {
        struct point v = minus(dots[i], dots[start]);
        double far = length(v) / length(across);
        double skew = fabs(v.x * across.x + v.y * across.y) / (length(v) * length(across));
        if ((long)i != start && far < 1.5 && skew < squarest) {
            bool turned = across.x * v.y - across.y * v.x < 0;
            squarest = skew;
            node->down = turned ? (struct point){-v.x, -v.y} : v;
            found = true;
        }
    }
    node->across = across;
    return found;
}

/* Give the neighbour of `from` that lies one step on its column and row. Steps follow the perspective as they go. */
static long step(const struct point *dots, size_t count, struct node *nodes, long from, int column,
                 int row)
{
    const struct node *node = &nodes[from];
    struct point way = {column * node->across.x + row * node->down.x,
                        column * node->across.y + row * node->down.y};
    struct point place = {dots[from].x + way.x, dots[from].y + way.y};
    long next = nearest(dots, count, place, reach_share * length(way), from);
    if (next == UNKNOWN || nodes[next].known) {
        return UNKNOWN;
    }
    struct point taken = minus(dots[next], dots[from]);
    nodes[next] =
        (struct node){true, node->column + column, node->row + row, node->across, node->down};
    if (column) {
        nodes[next].across = (struct point){column * taken.x, column * taken.y};
    } else {
        nodes[next].down = (struct point){row * taken.x, row * taken.y};
    }
    return next;
}

/* Walk from dot to dot. `queue` holds `count` indices. */
static void walk(const struct point *dots, size_t count, long start, struct node *nodes,
                 long *queue)
{
    static const int ways[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
    size_t ended = 0;
    size_t done = 0;
    queue[ended++] = start;
    while (done < ended) {
        long from = queue[done++];
        for (int w = 0; w < 4; w++) {
            long next = step(dots, count, nodes, from, ways[w][0], ways[w][1]);
            if (next != UNKNOWN) {
                queue[ended++] = next;
            }
        }
    }
}

static int fit(struct point_pair *pairs, size_t count, double spacing, double *scratch,
               struct homography *map, struct nacre_error *error)
{
    int status = homography_fit(pairs, count, map, error);
    for (int round = 0; status == NACRE_OK && round < 3; round++) {
        status = homography_refine(pairs, count, map, error);
        for (size_t i = 0; i < count; i++) {
            scratch[i] = homography_distance(map, &pairs[i]);
        }
        qsort(scratch, count, sizeof *scratch, compare_doubles);
        double limit =
            fmax(reject_deviations * scratch[count / 2] / 1.1774, reject_floor * spacing);
        for (size_t i = 0; i < count; i++) {
            pairs[i].outlier = homography_distance(map, &pairs[i]) > limit;
        }
    }
    return status == NACRE_OK ? homography_refine(pairs, count, map, error) : status;
}

static void note_spread(const struct point_pair *pairs, size_t count, struct lattice *lattice)
{
    struct point sum = {0, 0};
    double squares = 0;
    for (size_t i = 0; i < count; i++) {
        const struct point *p = &pairs[i].camera;
        if (!pairs[i].outlier) {
            lattice->dots++;
            sum.x += p->x;
            sum.y += p->y;
            squares += p->x * p->x + p->y * p->y;
        }
    }
    double used = (double)lattice->dots;
    lattice->spread = sqrt(fmax(squares - (sum.x * sum.x + sum.y * sum.y) / used, 0));
    lattice->rms = homography_rms(&lattice->map, pairs, count);
}

static int fail_few(size_t dots, struct nacre_error *error)
{
    return nacre_fail(error,
                      "%zu dots in a square lattice were found where %d are needed; use a target "
                      "with more or clearer dots in the region, and no other marks",
                      dots, DOTS_NEEDED);
}

/* Rows and columns as long as each other, and across each other, where the walk began. */
static int check_square(const struct homography *map, struct nacre_error *error)
{
    struct point across = minus(homography_apply(map, (struct point){0.5, 0}),
                                homography_apply(map, (struct point){-0.5, 0}));
    struct point down = minus(homography_apply(map, (struct point){0, 0.5}),
                              homography_apply(map, (struct point){0, -0.5}));
    double ratio = length(across) / length(down);
    double cosine = (across.x * down.x + across.y * down.y) / (length(across) * length(down));
    return fabs(cosine) < square_cosine && ratio < square_ratio && ratio > 1 / square_ratio
               ? NACRE_OK
               : nacre_fail(error,
                            "the target's dots lie in no square lattice: they are %.2g times as "
                            "far apart in one direction as in the other, at %.0f degrees; use a "
                            "target whose rows and columns are alike",
                            ratio, acos(cosine) * 180 / M_PI);
}

int lattice_find(const struct point *dots, size_t count, struct lattice *lattice,
                 struct nacre_error *error)
{
    size_t used = 0;
    int status = NACRE_OK;
    struct node *nodes = calloc(count + 1, sizeof *nodes);
    long *queue = malloc((count + 1) * sizeof *queue);
    struct point_pair *pairs = malloc((count + 1) * sizeof *pairs);
    double *scratch = malloc(2 * (count + 1) * sizeof *scratch);
    *lattice = (struct lattice){.dots = 0};
    if (!nodes || !queue || !pairs || !scratch) {
        status = nacre_fail_memory(error, "the target's dots");
        goto out;
    }
    if (count < DOTS_NEEDED) {
        status = fail_few(count, error);
        goto out;
    }
    long start = find_start(dots, count, scratch);
    nodes[start].known = true;
    if (!find_basis(dots, count, start, &nodes[start])) {
        status = fail_few(1, error);
        goto out;
    }
    double spacing = length(nodes[start].across);
    walk(dots, count, start, nodes, queue);
    for (size_t i = 0; i < count; i++) {
        if (nodes[i].known) {
            pairs[used++] = (struct point_pair){{nodes[i].column, nodes[i].row}, dots[i], false};
        }
    }
    status = used < DOTS_NEEDED ? fail_few(used, error)
                                : fit(pairs, used, spacing, scratch, &lattice->map, error);
    if (status == NACRE_OK) {
        note_spread(pairs, used, lattice);
        status = lattice->dots < DOTS_NEEDED ? fail_few(lattice->dots, error)
                                             : check_square(&lattice->map, error);
    }
out:
    free(nodes);
    free(queue);
    free(pairs);
    free(scratch);
    return status;
}
