/* Posts in the middle of the receivers that use them. */
#include "render/posts.h"

#include "render/groups.h"
#include "render/vector.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* A post whose receivers lie farther from it than this many spacings, or whose normals' mean is shorter than this, is
 * parted by place in space. */
static const double widest = 3.7, straightest = 0.8;

/* Posts stand off the middles of the squares of their own size by this share of one, along both axes: what a sum over a
 * lattice of squares has too much at their middles it has too little between them, and nothing here. */
static const double shift = 0.25;

/* Sums over a post's receivers. */
struct heap {
    double weight;
    struct vec3 position, along_x, along_y, normal;
    double x, y;
    bool parted;
};

struct lattice {
    const struct receiver *receivers;
    size_t count;
    double spacing, point_mm;
    struct posts *posts;
    struct groups groups;
    struct heap *heaps;
};

static struct group_key key_of(const struct lattice *lattice, const struct receiver *r, size_t k)
{
    double row = (double)(k >= 3) + (double)(k >= 6);
    double x = floor((double)r->along_x[3] / lattice->spacing - shift) + (double)(k % 3) - 1;
    double y = floor((double)r->along_y[3] / lattice->spacing - shift) + row - 1;
    int32_t kind =
        (r->column * 64 + r->chart) * 4 + (r->flip_x < 0 ? 2 : 0) + (r->flip_y < 0 ? 1 : 0);
    return (struct group_key){kind, (int32_t)fmin(fmax(x, -1e9), 1e9),
                              (int32_t)fmin(fmax(y, -1e9), 1e9), 0};
}

static void weigh(double place, double spacing, double weights[3])
{
    double t = place / spacing - shift, u = t - floor(t) - 0.5;
    weights[0] = (0.5 - u) * (0.5 - u) / 2;
    weights[1] = 0.75 - u * u;
    weights[2] = (0.5 + u) * (0.5 + u) / 2;
}

/* Receivers between the same posts have the same nine: they are looked up once for the first of them. With heaps, posts that
 * are parted are told apart by place, too. */
static int link_receiver(struct lattice *lattice, struct groups *cells, uint32_t *firsts, size_t i)
{
    struct posts *posts = lattice->posts;
    const struct receiver *r = &lattice->receivers[i];
    uint32_t *links = &posts->links[i * POSTS_A_RECEIVER];
    if (!lattice->heaps) {
        size_t before = cells->count;
        uint32_t cell = groups_number(cells, key_of(lattice, r, 0));
        if (cell == GROUPS_FULL) {
            return -1;
        }
        if (cells->count == before) {
            memcpy(links, &posts->links[firsts[cell] * (size_t)POSTS_A_RECEIVER],
                   POSTS_A_RECEIVER * sizeof *links);
            return 0;
        }
        firsts[cell] = (uint32_t)i;
    }
    double cube = 2 * lattice->spacing * lattice->point_mm;
    for (size_t k = 0; k < POSTS_A_RECEIVER; k++) {
        struct group_key key = key_of(lattice, r, k);
        key.part = lattice->heaps && lattice->heaps[links[k]].parted
                       ? groups_part(r->position, r->normal, cube)
                       : 0;
        links[k] = groups_number(&lattice->groups, key);
        if (links[k] == GROUPS_FULL) {
            return -1;
        }
    }
    return 0;
}

/* Number the posts of all receivers; with heaps, those of parted posts by place, too. */
static int link_posts(struct lattice *lattice)
{
    struct groups cells = {0};
    uint32_t *firsts = calloc(lattice->count + 1, sizeof *firsts);
    groups_end(&lattice->groups);
    int status = firsts && groups_begin(&lattice->groups, lattice->count / 2) == 0 &&
                         groups_begin(&cells, lattice->count / 2) == 0
                     ? 0
                     : -1;
    for (size_t i = 0; status == 0 && i < lattice->count; i++) {
        const struct receiver *r = &lattice->receivers[i];
        float *weights = &lattice->posts->weights[i * POSTS_A_RECEIVER];
        double across[3], down[3];
        weigh((double)r->along_x[3], lattice->spacing, across);
        weigh((double)r->along_y[3], lattice->spacing, down);
        for (size_t k = 0; k < POSTS_A_RECEIVER; k++) {
            weights[k] = (float)(across[k % 3] * down[k / 3]);
        }
        status = link_receiver(lattice, &cells, firsts, i);
    }
    groups_end(&cells);
    free(firsts);
    return status;
}

static void add_receiver(struct heap *heap, double weight, const struct receiver *r)
{
    heap->weight += weight;
    heap->position = vec3_along(heap->position, weight, vec3_from(r->position));
    heap->along_x = vec3_along(heap->along_x, weight, vec3_from(r->along_x));
    heap->along_y = vec3_along(heap->along_y, weight, vec3_from(r->along_y));
    heap->normal = vec3_along(heap->normal, weight, vec3_from(r->normal));
    heap->x += weight * (double)r->along_x[3];
    heap->y += weight * (double)r->along_y[3];
}

/* Put a post where its place in the texture is, as the surface goes on from the middle of its receivers. */
static void place_post(const struct lattice *lattice, struct heap *heap, const struct receiver *r,
                       size_t k, struct receiver *post)
{
    struct group_key key = key_of(lattice, r, k);
    double scale = 1 / heap->weight, x = (key.x + 0.5 + shift) * lattice->spacing,
           y = (key.y + 0.5 + shift) * lattice->spacing;
    struct vec3 along_x = vec3_scale(heap->along_x, scale),
                along_y = vec3_scale(heap->along_y, scale);
    struct vec3 position = vec3_scale(heap->position, scale);
    double square_x = fmax(vec3_dot(along_x, along_x), 0.01),
           square_y = fmax(vec3_dot(along_y, along_y), 0.01);
    position = vec3_along(position, (x - heap->x * scale) * lattice->point_mm / square_x, along_x);
    position = vec3_along(position, (y - heap->y * scale) * lattice->point_mm / square_y, along_y);
    heap->parted = vec3_length(heap->normal) * scale < straightest;
    *post = (struct receiver){
        .chart = r->chart, .column = r->column, .flip_x = r->flip_x, .flip_y = r->flip_y};
    vec3_store(position, post->position);
    vec3_store(along_x, post->along_x);
    vec3_store(along_y, post->along_y);
    vec3_store(vec3_unit(heap->normal), post->normal);
    post->along_x[3] = (float)x;
    post->along_y[3] = (float)y;
}

static int fill_posts(struct lattice *lattice)
{
    struct posts *posts = lattice->posts;
    size_t links = lattice->count * POSTS_A_RECEIVER;
    free(lattice->heaps);
    free(posts->list);
    posts->count = lattice->groups.count;
    lattice->heaps = calloc(posts->count + 1, sizeof *lattice->heaps);
    posts->list = calloc(posts->count + 1, sizeof *posts->list);
    if (!lattice->heaps || !posts->list) {
        return -1;
    }
    for (size_t i = 0; i < links; i++) {
        /* A post at the rim of a receiver's splines still needs a place. */
        add_receiver(&lattice->heaps[posts->links[i]], (double)posts->weights[i] + 1e-6,
                     &lattice->receivers[i / POSTS_A_RECEIVER]);
    }
    size_t placed = 0;
    for (size_t i = 0; i < links; i++) {
        if (posts->links[i] == placed) { /* numbers are in the order of first use */
            place_post(lattice, &lattice->heaps[placed], &lattice->receivers[i / POSTS_A_RECEIVER],
                       i % POSTS_A_RECEIVER, &posts->list[placed]);
            placed++;
        }
    }
    return 0;
}

/* Whether some posts' receivers are too far from them or turned too differently; marks the posts. */
static bool must_part(struct lattice *lattice)
{
    const struct posts *posts = lattice->posts;
    float most = (float)(widest * lattice->spacing * lattice->point_mm);
    bool any = false;
    for (size_t i = 0; i < lattice->count * POSTS_A_RECEIVER; i++) {
        const float *p = lattice->receivers[i / POSTS_A_RECEIVER].position;
        const float *q = posts->list[posts->links[i]].position;
        float x = p[0] - q[0], y = p[1] - q[1], z = p[2] - q[2];
        struct heap *heap = &lattice->heaps[posts->links[i]];
        heap->parted = heap->parted || x * x + y * y + z * z > most * most;
    }
    for (size_t i = 0; i < posts->count; i++) {
        any = any || lattice->heaps[i].parted;
    }
    return any;
}

int posts_make(struct posts *posts, const struct receiver *receivers, size_t count, double spacing,
               double point_mm, struct nacre_error *error)
{
    struct lattice lattice = {.receivers = receivers,
                              .count = count,
                              .spacing = spacing,
                              .point_mm = point_mm,
                              .posts = posts};
    *posts = (struct posts){
        .links = calloc(count * POSTS_A_RECEIVER + 1, sizeof *posts->links),
        .weights = calloc(count * POSTS_A_RECEIVER + 1, sizeof *posts->weights),
    };
    int status = posts->links && posts->weights ? link_posts(&lattice) : -1;
    if (status == 0) {
        status = fill_posts(&lattice);
    }
    if (status == 0 && must_part(&lattice)) {
        status = link_posts(&lattice);
        if (status == 0) {
            status = fill_posts(&lattice);
        }
    }
    groups_end(&lattice.groups);
    free(lattice.heaps);
    if (status != 0) {
        posts_finish(posts);
        return nacre_fail_memory(error, "summing up light for the mesh");
    }
    return NACRE_OK;
}

void posts_finish(struct posts *posts)
{
    free(posts->list);
    free(posts->links);
    free(posts->weights);
    *posts = (struct posts){0};
}
