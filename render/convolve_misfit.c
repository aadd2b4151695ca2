/* How far the places in the texture serve each part of a patch: offsets by the texture against offsets by space. */
#include "render/convolve_patches.h"
#include "render/groups.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { AROUND = 27 };

/* A piece of surface: a cell of a patch, or a vertex outside patches. */
struct piece {
    uint32_t receiver;
    int patch;
    float area;
};

struct survey {
    const struct convolve_patches *patches;
    const struct mapping *mapping;
    const struct receivers *receivers;
    bool same_side;
    int side;     /* of the table, K + 2 */
    float *table; /* [side][side]: what of light leaves at an offset, mean over the material */
    size_t count;
    struct piece *pieces; /* by cubes */
    uint32_t *cubes;      /* [count]: of each piece */
    size_t cube_count;
    uint32_t *starts;           /* [cubes + 1] */
    uint32_t (*around)[AROUND]; /* of each cube, or CONVOLVE_NONE */
};

/* The sum over terms and colours of F's mean times H's mean times the kernel. */
static int make_table(struct survey *survey, const struct appearance *a)
{
    size_t terms = (size_t)a->terms, planes = (size_t)a->factor_channels;
    size_t texels = (size_t)a->width * (size_t)a->height, side = (size_t)a->window + 2;
    double *means = calloc(2 * terms * planes + 1, sizeof *means);
    survey->side = a->window + 2;
    survey->table = calloc(side * side, sizeof *survey->table);
    if (!means || !survey->table) {
        free(means);
        return -1;
    }
    for (size_t i = 0; i < texels * planes * terms; i++) {
        means[i % (planes * terms)] += a->f[i];
        means[planes * terms + i % (planes * terms)] += a->h[i];
    }
    for (size_t i = 0; i < side * side * terms; i++) {
        for (size_t c = 0; c < 3; c++) {
            size_t k = (planes == 1 ? 0 : c) * terms + i % terms;
            survey->table[i / terms] +=
                (float)(means[k] * means[planes * terms + k] * a->kernels[i * 4 + c]);
        }
    }
    free(means);
    return 0;
}

static double table_at(const struct survey *survey, double u, double v)
{
    double last = survey->side - 1;
    if (!(u > 0 && u < last && v > 0 && v < last)) {
        return 0;
    }
    size_t side = (size_t)survey->side, x = (size_t)u, y = (size_t)v;
    double fx = u - (double)x, fy = v - (double)y;
    const float *g = survey->table + y * side + x;
    return (1 - fy) * ((1 - fx) * g[0] + fx * g[1]) + fy * ((1 - fx) * g[side] + fx * g[side + 1]);
}

/* Pieces in the order of patches, cells and receivers. */
static int list_pieces(struct survey *survey, const float *areas)
{
    const struct convolve_patches *patches = survey->patches;
    size_t all = survey->receivers->count;
    uint32_t *numbers =
        calloc(all + 1, sizeof *numbers); /* of the pieces that receivers stand for */
    survey->pieces = calloc(all + 1, sizeof *survey->pieces);
    if (!numbers || !survey->pieces) {
        free(numbers);
        return -1;
    }
    for (size_t i = 0; i < all; i++) {
        int patch = patches->of[i];
        uint32_t place = (uint32_t)i;
        if (patch < 0 && !(areas[i] > 0)) {
            continue;
        }
        if (patch >= 0) {
            place = convolve_place(&patches->list[patch], &survey->receivers->list[i]);
        }
        if (place == i) { /* a cell's place is its first receiver */
            numbers[i] = (uint32_t)survey->count;
            survey->pieces[survey->count++] = (struct piece){place, patch, 0};
        }
        survey->pieces[numbers[place]].area += areas[i];
    }
    free(numbers);
    return 0;
}

static struct group_key cube_key(const float position[3], double cube_mm, const int step[3])
{
    int32_t k[3];
    for (int i = 0; i < 3; i++) {
        k[i] = (int32_t)fmin(fmax(floor((double)position[i] / cube_mm), -1e9), 1e9) + step[i];
    }
    return (struct group_key){k[0], k[1], k[2], 0};
}

/* Number the cubes that pieces lie in, and those around each. */
static int number_cubes(struct survey *survey, double cube_mm)
{
    const int none[3] = {0};
    struct groups groups;
    uint32_t *example = calloc(survey->count + 1, sizeof *example);
    survey->cubes = calloc(survey->count + 1, sizeof *survey->cubes);
    if (!example || !survey->cubes || groups_begin(&groups, 64) != 0) {
        free(example);
        return -1;
    }
    int status = 0;
    for (size_t i = 0; i < survey->count; i++) {
        const float *position = survey->receivers->list[survey->pieces[i].receiver].position;
        uint32_t cube = groups_number(&groups, cube_key(position, cube_mm, none));
        status = cube == GROUPS_FULL ? -1 : status;
        if (status == 0) {
            survey->cubes[i] = cube;
            example[cube] = survey->pieces[i].receiver;
        }
    }
    survey->cube_count = status == 0 ? groups.count : 0;
    survey->around = calloc(survey->cube_count + 1, sizeof *survey->around);
    for (size_t i = 0; survey->around && i < survey->cube_count; i++) {
        for (int k = 0; k < AROUND; k++) {
            const int step[3] = {k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1};
            uint32_t cube = groups_number(
                &groups, cube_key(survey->receivers->list[example[i]].position, cube_mm, step));
            survey->around[i][k] = cube < survey->cube_count ? cube : CONVOLVE_NONE;
        }
    }
    groups_end(&groups);
    free(example);
    return survey->around ? status : -1;
}

static int sort_by_cubes(struct survey *survey)
{
    struct piece *sorted = calloc(survey->count + 1, sizeof *sorted);
    uint32_t *cubes = calloc(survey->count + 1, sizeof *cubes);
    survey->starts = calloc(survey->cube_count + 2, sizeof *survey->starts);
    if (!sorted || !cubes || !survey->starts) {
        free(sorted);
        free(cubes);
        return -1;
    }
    uint32_t *at = survey->starts + 1; /* ends up as the starts, one cube on */
    for (size_t i = 0; i < survey->count; i++) {
        at[survey->cubes[i]]++;
    }
    uint32_t sum = 0;
    for (size_t i = 0; i < survey->cube_count; i++) {
        uint32_t own = at[i];
        at[i] = sum;
        sum += own;
    }
    for (size_t i = 0; i < survey->count; i++) {
        uint32_t place = at[survey->cubes[i]]++;
        sorted[place] = survey->pieces[i];
        cubes[place] = survey->cubes[i];
    }
    free(survey->pieces);
    free(survey->cubes);
    survey->pieces = sorted;
    survey->cubes = cubes;
    return 0;
}

/* What leaves at `to` of the light on another piece, by its place in space and in the texture. */
static void compare(const struct survey *survey, const struct piece *to, const struct piece *from,
                    double *in_space, double *in_texture)
{
    const struct receiver *o = &survey->receivers->list[to->receiver];
    const struct receiver *i = &survey->receivers->list[from->receiver];
    struct vec3 offset = vec3_subtract(vec3_from(o->position), vec3_from(i->position));
    double half = (survey->side - 1) / 2.0, square = vec3_dot(offset, offset);
    double a = vec3_dot(offset, vec3_from(o->along_x)), b = vec3_dot(offset, vec3_from(o->along_y));
    *in_space = *in_texture = 0;
    if (from->patch == to->patch) {
        *in_texture = table_at(survey, o->flip_x * ((double)o->along_x[3] - i->along_x[3]) + half,
                               o->flip_y * ((double)o->along_y[3] - i->along_y[3]) + half);
    }
    if (survey->same_side && vec3_dot(vec3_from(o->normal), vec3_from(i->normal)) <= 0) {
        return;
    }
    if (!(a * a + b * b > 1e-10 * square)) {
        a = 1;
        b = 0;
    }
    double scale = sqrt(square / (a * a + b * b)) / survey->mapping->point_mm;
    *in_space = table_at(survey, o->flip_x * a * scale + half, o->flip_y * b * scale + half);
}

static float misfit_of(const struct survey *survey, size_t index)
{
    const struct piece *to = &survey->pieces[index];
    double off = 0, all = 0;
    for (int k = 0; k < AROUND; k++) {
        uint32_t cube = survey->around[survey->cubes[index]][k];
        for (uint32_t j = cube == CONVOLVE_NONE ? 0 : survey->starts[cube];
             cube != CONVOLVE_NONE && j < survey->starts[cube + 1]; j++) {
            double in_space, in_texture;
            compare(survey, to, &survey->pieces[j], &in_space, &in_texture);
            off += survey->pieces[j].area * fabs(in_space - in_texture);
            all += survey->pieces[j].area * in_space;
        }
    }
    return all > 0 ? (float)(off / all) : HUGE_VALF;
}

static void spread(struct convolve_patches *patches, const struct receivers *receivers)
{
    for (size_t i = 0; i < receivers->count; i++) {
        patches->misfit[i] =
            patches->of[i] < 0
                ? HUGE_VALF
                : patches
                      ->misfit[convolve_place(&patches->list[patches->of[i]], &receivers->list[i])];
    }
}

int convolve_misfit(struct convolve_patches *patches, const struct mapping *mapping,
                    const struct appearance *appearance, const struct receivers *receivers,
                    const float *areas, bool same_side)
{
    struct survey survey = {
        .patches = patches, .mapping = mapping, .receivers = receivers, .same_side = same_side};
    /* The NOLINT is for K, which is odd. */
    double reach = 1.4142136 * (appearance->window / 2 + 1); /* NOLINT */
    int status = make_table(&survey, appearance);
    if (status == 0) {
        status = list_pieces(&survey, areas);
    }
    if (status == 0) {
        status = number_cubes(&survey, reach * mapping->point_mm);
    }
    if (status == 0) {
        status = sort_by_cubes(&survey);
    }
    if (status == 0) {
#pragma omp parallel for schedule(dynamic, 64)
        for (size_t i = 0; i < survey.count; i++) {
            if (survey.pieces[i].patch >= 0) {
                patches->misfit[survey.pieces[i].receiver] = misfit_of(&survey, i);
            }
        }
        spread(patches, receivers);
    }
    free(survey.table);
    free(survey.pieces);
    free(survey.cubes);
    free(survey.starts);
    free(survey.around);
    return status;
}
