/* Light of a grid shared out among its lit points where their windows overlap. */
#include "rig/develop/share.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A_j moves by the foreign light in its ring, a few per cent of it: three rounds leave less than a thousandth. */
enum { ROUNDS = 3 };

/* Against what the profile makes of its light nearer by, a tail is not weaker than this. */
static const double tail_share = 0.1;

struct share {
    const struct nacre_scan_info *info;
    const struct plan_grids *laid;
    int reach;        /* along x and y, to which a profile is looked up */
    double *profile;  /* [channels][(reach + 1)^2]: by the distance along x and along y */
    double *strength; /* [lit points][channels]: A_j */
    double *sum;      /* [channels][height][width]: of all lit points' A g */
    int grid;
};

/* g between the radii that the plan has: geometric; beyond, as it falls between the last two. */
static double profile_at(const double *profile, int count, double r)
{
    int at = (int)r < count - 2 ? (int)r : count - 2;
    return profile[at] * pow(profile[at + 1] / profile[at], r - at);
}

static double *tabulate(const struct plan *plan, int channels, int reach)
{
    size_t side = (size_t)reach + 1;
    int count = (int)(plan->profile_count / (size_t)channels);
    double *table = malloc((size_t)channels * side * side * sizeof *table);
    for (size_t i = 0; table && i < (size_t)channels * side * side; i++) {
        table[i] = profile_at(plan->profile + i / (side * side) * (size_t)count, count,
                              hypot((double)(i / side % side), (double)(i % side)));
    }
    return table;
}

int share_new(const struct nacre_scan_info *info, const struct plan *plan, struct share **share,
              struct nacre_error *error)
{
    const struct plan_grids *laid = plan->grids;
    uint32_t most = 1;
    *share = NULL;
    if (plan->profile_count == 0) {
        return NACRE_OK;
    }
    struct share *made = calloc(1, sizeof *made);
    if (!made) {
        return nacre_fail_memory(error, "what shares a grid's light");
    }
    for (int g = 0; g < laid->count; g++) {
        uint32_t lit = laid->starts[g + 1] - laid->starts[g];
        most = lit > most ? lit : most;
    }
    /* A window's corner is a whole window from the lit points that its light may come from. */
    *made = (struct share){.info = info, .laid = laid, .reach = info->window - 1};
    size_t channels = (size_t)info->channels;
    made->profile = tabulate(plan, info->channels, made->reach);
    made->strength = malloc(most * channels * sizeof *made->strength);
    made->sum = malloc(channels * (size_t)info->width * (size_t)info->height * sizeof *made->sum);
    if (!made->profile || !made->strength || !made->sum) {
        share_free(made);
        return nacre_fail_memory(error, "what shares a grid's light");
    }
    *share = made;
    return NACRE_OK;
}

void share_free(struct share *share)
{
    if (share) {
        free(share->profile);
        free(share->strength);
        free(share->sum);
        free(share);
    }
}

static int smaller(int a, int b)
{
    return a < b ? a : b;
}

static int larger(int a, int b)
{
    return a > b ? a : b;
}

/* Points within `reach` of a lit point, inside the sample. */
struct box {
    int x, y, left, right, top, bottom;
};

static struct box box_around(const struct share *share, size_t index, int reach)
{
    const struct plan_grids *laid = share->laid;
    int point = (int)laid->points[laid->starts[share->grid] + index];
    int x = point % laid->width;
    int y = point / laid->width;
    return (struct box){x,
                        y,
                        larger(x - reach, 0),
                        smaller(x + reach, laid->width - 1),
                        larger(y - reach, 0),
                        smaller(y + reach, laid->height - 1)};
}

static const double *profile_row(const struct share *share, int channel, int down)
{
    size_t side = (size_t)share->reach + 1;
    return share->profile + ((size_t)channel * side + (size_t)abs(down)) * side;
}

static size_t row_of(const struct share *share, int channel, int y)
{
    return ((size_t)channel * (size_t)share->info->height + (size_t)y) * (size_t)share->info->width;
}

static void sum_all(struct share *share, size_t lit)
{
    const struct nacre_scan_info *info = share->info;
    memset(share->sum, 0,
           (size_t)info->channels * (size_t)info->width * (size_t)info->height *
               sizeof *share->sum);
    for (size_t i = 0; i < lit; i++) {
        struct box box = box_around(share, i, share->reach);
        for (int c = 0; c < info->channels; c++) {
            double strength = share->strength[i * (size_t)info->channels + (size_t)c];
            for (int y = box.top; y <= box.bottom; y++) {
                const double *profile = profile_row(share, c, y - box.y);
                double *sum = share->sum + row_of(share, c, y);
                for (int x = box.left; x <= box.right; x++) {
                    sum[x] += strength * profile[abs(x - box.x)];
                }
            }
        }
    }
}

/* What a lit point's own light is of the profile, where its tail is told from its neighbours', and nearer by. */
struct measured {
    double own[2], expected[2]; /* near, tail */
};

static void measure_row(const struct share *share, int channel, int y, const struct box *box,
                        int inner, double strength, const float *reflected,
                        struct measured *measured)
{
    const double *profile = profile_row(share, channel, y - box->y);
    const double *sum = share->sum + row_of(share, channel, y);
    const float *light = reflected + row_of(share, channel, y);
    for (int x = box->left; x <= box->right; x++) {
        int apart = larger(abs(x - box->x), abs(y - box->y));
        if (apart > 0 && !isnan(light[x])) {
            double part = profile[abs(x - box->x)];
            measured->own[apart >= inner] += (double)light[x] * strength * part / sum[x];
            measured->expected[apart >= inner] += part;
        }
    }
}

/* Where the tail is lost in noise the light nearer by says what it is at least, or a point would lose even its middle. */
static void measure_strength(struct share *share, size_t index, const float *reflected)
{
    const struct nacre_scan_info *info = share->info;
    const struct plan_grids *laid = share->laid;
    int spacing = laid->spacings[laid->points[laid->starts[share->grid] + index]];
    int outer = larger(smaller(spacing / 2, info->window / 2), 1);
    int inner = larger(outer / 2, 1);
    struct box box = box_around(share, index, outer);
    for (int c = 0; c < info->channels; c++) {
        double *strength = &share->strength[index * (size_t)info->channels + (size_t)c];
        struct measured measured = {{0}, {0}};
        double least = 1e-12;
        for (int y = box.top; y <= box.bottom; y++) {
            measure_row(share, c, y, &box, inner, *strength, reflected, &measured);
        }
        if (measured.expected[0] > 0) {
            least = fmax(least, tail_share * measured.own[0] / measured.expected[0]);
        }
        if (measured.expected[1] > 0) {
            *strength = fmax(measured.own[1] / measured.expected[1], least);
        }
    }
}

void share_begin(struct share *share, int grid, const float *reflected)
{
    share->grid = grid;
    size_t lit = share->laid->starts[grid + 1] - share->laid->starts[grid];
    for (size_t i = 0; i < lit * (size_t)share->info->channels; i++) {
        share->strength[i] = 1;
    }
    for (int round = 0; round < ROUNDS; round++) {
        sum_all(share, lit);
        for (size_t i = 0; i < lit; i++) {
            measure_strength(share, i, reflected);
        }
    }
    sum_all(share, lit);
}

void share_apply(const struct share *share, size_t index, float *response)
{
    const struct nacre_scan_info *info = share->info;
    int window = info->window;
    int half = window / 2;
    struct box box = box_around(share, index, half);
    for (int c = 0; c < info->channels; c++) {
        double strength = share->strength[index * (size_t)info->channels + (size_t)c];
        for (int y = box.top; y <= box.bottom; y++) {
            const double *profile = profile_row(share, c, y - box.y);
            const double *sum = share->sum + row_of(share, c, y);
            float *row = response +
                         ((size_t)c * (size_t)window + (size_t)(y - box.y + half)) * (size_t)window;
            for (int x = box.left; x <= box.right; x++) {
                row[x - box.x + half] *= (float)(strength * profile[abs(x - box.x)] / sum[x]);
            }
        }
    }
}
