/* Plan files: reading, the order of patterns, and drawing them. */
#include "rig/plan.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

const char *const pattern_kind_names[] = {"black", "white", "dots", "grid", NULL};

static const char *const orders[] = {"random", "sequential", NULL};

/* Many patterns are a mistake long before they are 10^6, where frame names would grow. */
enum { SPACING_MAXIMUM = 512, EXPOSURES_MAXIMUM = 64, REGION_MAXIMUM = 65535 };

static const struct settings_field region_fields[] = {
    {.key = "x",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan_region, x),
     .maximum = REGION_MAXIMUM,
     .required = true,
     .sentence = "left border, surface points"},
    {.key = "y",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan_region, y),
     .maximum = REGION_MAXIMUM,
     .required = true,
     .sentence = "upper border, surface points"},
    {.key = "width",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan_region, width),
     .minimum = 1,
     .maximum = REGION_MAXIMUM,
     .required = true,
     .sentence = "surface points"},
    {.key = "height",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan_region, height),
     .minimum = 1,
     .maximum = REGION_MAXIMUM,
     .required = true,
     .sentence = "surface points"},
    {.key = "spacing",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan_region, spacing),
     .minimum = 1,
     .maximum = SPACING_MAXIMUM,
     .required = true,
     .sentence = "surface points from a lit point here to the next of the same grid"},
    {.key = "longest_turns",
     .kind = SETTINGS_REAL,
     .offset = offsetof(struct plan_region, longest_turns),
     .maximum = 1e6,
     .fallback = "0",
     .sentence = "exposures up to this one are enough here; 0: all"},
    {0}};

static const struct settings_schema region_schema = {.what = "region",
                                                     .size = sizeof(struct plan_region),
                                                     .fields = region_fields,
                                                     .line_offset =
                                                         offsetof(struct plan_region, line)};

static const struct settings_field fields[] = {
    {.key = "seed",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan, seed),
     .maximum = INT_MAX,
     .sentence = "of the random order of the grids"},
    {.key = "order",
     .kind = SETTINGS_CHOICE,
     .offset = offsetof(struct plan, order),
     .words = orders,
     .fallback = "random",
     .sentence = "in which the grids are shown; in random order a lamp's drift becomes noise"},
    {.key = "black_frames",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan, black_frames),
     .minimum = 1,
     .maximum = 10000,
     .fallback = "100",
     .sentence = "times the black pattern is measured"},
    {.key = "white_frames",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan, white_frames),
     .minimum = 1,
     .maximum = 10000,
     .fallback = "4",
     .sentence = "times the white pattern is measured"},
    {.key = "dot_spacing",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan, dot_spacing),
     .minimum = 2,
     .maximum = SPACING_MAXIMUM,
     .fallback = "12",
     .sentence = "projector pixels between dots",
     .line_offset = offsetof(struct plan, dots_line)},
    {.key = "dot_shift",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan, dot_shift),
     .minimum = 1,
     .maximum = SPACING_MAXIMUM,
     .fallback = "4",
     .sentence = "projector pixels from one dots pattern to the next"},
    {.key = "dot_size",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan, dot_size),
     .minimum = 1,
     .maximum = SPACING_MAXIMUM,
     .fallback = "2",
     .sentence = "side of a square dot in projector pixels"},
    {.key = "grid_spacing",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan, grid_spacing),
     .minimum = 1,
     .maximum = SPACING_MAXIMUM,
     .required = true,
     .sentence = "surface points between lit points of a grid; its square is the number of grids"},
    {.key = "grid_patterns",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan, grid_patterns),
     .maximum = (double)SPACING_MAXIMUM * SPACING_MAXIMUM,
     .fallback = "0",
     .sentence = "grids that are measured, a random choice of them; 0: all"},
    {.key = "window",
     .kind = SETTINGS_INT,
     .offset = offsetof(struct plan, window),
     .minimum = 1,
     .maximum = SPACING_MAXIMUM,
     .required = true,
     .sentence = "K of the K x K responses, odd; above a spacing only with a profile",
     .line_offset = offsetof(struct plan, window_line)},
    {.key = "exposure_turns",
     .kind = SETTINGS_NUMBERS,
     .offset = offsetof(struct plan, exposure_turns),
     .length_offset = offsetof(struct plan, exposure_count),
     .minimum = 0.01,
     .maximum = 1e6,
     .required = true,
     .sentence = "exposures in turns of the colour wheel, ascending",
     .line_offset = offsetof(struct plan, exposures_line)},
    {.key = "regions",
     .kind = SETTINGS_LIST,
     .offset = offsetof(struct plan, regions),
     .length_offset = offsetof(struct plan, region_count),
     .schema = &region_schema,
     .sentence = "rectangles with a spacing and a longest exposure of their own; the last that "
                 "holds a point counts"},
    {.key = "profile",
     .kind = SETTINGS_NUMBERS,
     .offset = offsetof(struct plan, profile),
     .length_offset = offsetof(struct plan, profile_count),
     .minimum = 1e-30,
     .maximum = 1e30,
     .sentence = "how responses fall with the distance, at 0, 1, 2 ... points, one colour after "
                 "the other: by "
                 "it light is shared out among windows that overlap",
     .line_offset = offsetof(struct plan, profile_line)},
    {0}};

const struct settings_schema plan_schema = {
    .what = "plan file", .size = sizeof(struct plan), .fields = fields};

static int check_exposures(const char *path, const struct plan *plan, struct nacre_error *error)
{
    if (plan->exposure_count < 1 || plan->exposure_count > EXPOSURES_MAXIMUM) {
        return nacre_fail(error, "%s:%d: exposure_turns: %zu exposures; give 1 to %d", path,
                          plan->exposures_line, plan->exposure_count, EXPOSURES_MAXIMUM);
    }
    for (size_t i = 1; i < plan->exposure_count; i++) {
        if (plan->exposure_turns[i] <= plan->exposure_turns[i - 1]) {
            return nacre_fail(
                error, "%s:%d: exposure_turns: %g follows %g; put them in ascending order", path,
                plan->exposures_line, plan->exposure_turns[i], plan->exposure_turns[i - 1]);
        }
    }
    return NACRE_OK;
}

/* What no single key can be refused for. */
static int check(const char *path, const struct plan *plan, struct nacre_error *error)
{
    if (plan->window % 2 == 0) {
        return nacre_fail(error, "%s:%d: window: %d is even; use %d or %d", path, plan->window_line,
                          plan->window, plan->window - 1, plan->window + 1);
    }
    if (plan->window > plan->grid_spacing && plan->profile_count == 0) {
        return nacre_fail(
            error,
            "%s:%d: window: %d is wider than grid_spacing %d, so responses of one grid "
            "would overlap; narrow it or widen grid_spacing, or give a profile (nacre plan)",
            path, plan->window_line, plan->window, plan->grid_spacing);
    }
    for (size_t i = 0; i < plan->region_count; i++) {
        const struct plan_region *region = &plan->regions[i];
        if (plan->window > region->spacing && plan->profile_count == 0) {
            return nacre_fail(error,
                              "%s:%d: regions: the window %d is wider than the spacing %d, so "
                              "responses of one grid would overlap; widen the spacing, or give a "
                              "profile (nacre plan)",
                              path, region->line, plan->window, region->spacing);
        }
    }
    if (plan->dot_size >= plan->dot_spacing || plan->dot_shift > plan->dot_spacing) {
        return nacre_fail(
            error, "%s:%d: dot_spacing: %d must be above dot_size %d and not below dot_shift %d",
            path, plan->dots_line, plan->dot_spacing, plan->dot_size, plan->dot_shift);
    }
    return check_exposures(path, plan, error);
}

/* Check what was read, and keep nothing of a plan that is refused. */
static int finish_reading(int status, const char *name, struct plan *plan,
                          struct nacre_error *error)
{
    if (status == NACRE_OK) {
        status = check(name, plan, error);
    }
    if (status != NACRE_OK) {
        plan_finish(plan);
    }
    return status;
}

int plan_read(const char *path, struct plan *plan, struct nacre_error *error)
{
    return finish_reading(settings_read(path, &plan_schema, plan, error), path, plan, error);
}

int plan_parse(const char *name, const char *text, size_t size, struct plan *plan,
               struct nacre_error *error)
{
    int status = settings_parse(name, "/", text, size, &plan_schema, plan, error);
    return finish_reading(status, name, plan, error);
}

void plan_finish(struct plan *plan)
{
    plan_grids_free(plan->grids);
    settings_finish(&plan_schema, plan);
}

int plan_lay(struct plan *plan, const char *name, int width, int height, int channels,
             struct nacre_error *error)
{
    for (size_t i = 0; i < plan->region_count; i++) {
        const struct plan_region *region = &plan->regions[i];
        if (region->x + region->width > width || region->y + region->height > height) {
            return nacre_fail(error,
                              "%s:%d: regions: %d x %d points at %d, %d reach out of the sample "
                              "of %d x %d",
                              name, region->line, region->width, region->height, region->x,
                              region->y, width, height);
        }
    }
    if (plan->profile_count && (plan->profile_count % (size_t)channels != 0 ||
                                plan->profile_count < 2 * (size_t)channels)) {
        return nacre_fail(error,
                          "%s:%d: profile: %zu numbers; give as many for each of %d colours, two "
                          "or more",
                          name, plan->profile_line, plan->profile_count, channels);
    }
    plan_grids_free(plan->grids);
    return plan_grids_new(plan, width, height, &plan->grids, error);
}

bool pattern_kind_wants_white_layer(enum pattern_kind kind)
{
    return kind == PATTERN_WHITE || kind == PATTERN_DOTS;
}

static int dot_steps(const struct plan *plan)
{
    return (plan->dot_spacing + plan->dot_shift - 1) / plan->dot_shift;
}

int plan_pattern_count(const struct plan *plan, enum pattern_kind kind)
{
    switch (kind) {
    case PATTERN_BLACK:
        return plan->black_frames;
    case PATTERN_WHITE:
        return plan->white_frames;
    case PATTERN_DOTS:
        return dot_steps(plan) * dot_steps(plan);
    case PATTERN_GRID:
        return plan->grids ? plan->grids->count : plan->grid_spacing * plan->grid_spacing;
    case PATTERN_KINDS:
        break;
    }
    return 0;
}

int plan_shown_count(const struct plan *plan, enum pattern_kind kind)
{
    int all = plan_pattern_count(plan, kind);
    bool some = kind == PATTERN_GRID && plan->grid_patterns > 0 && plan->grid_patterns < all;
    return some ? plan->grid_patterns : all;
}

size_t plan_pattern_exposures(const struct plan *plan, struct pattern pattern)
{
    return pattern.kind == PATTERN_GRID && plan->grids ? plan->grids->exposures[pattern.number]
                                                       : plan->exposure_count;
}

/* SplitMix64 (Steele, Lea and Flood 2014): the same numbers on every machine. */
static uint64_t random_next(uint64_t *state)
{
    uint64_t z = *state += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

/* Uniform in 0 .. bound - 1: the top of a range that is no whole multiple of bound is drawn again.
 */
static size_t random_below(uint64_t *state, size_t bound)
{
    uint64_t limit = UINT64_MAX - UINT64_MAX % bound;
    uint64_t value;
    do {
        value = random_next(state);
    } while (value >= limit);
    return (size_t)(value % bound);
}

/* Fisher and Yates. */
static void shuffle(struct pattern *patterns, size_t count, uint64_t seed)
{
    for (size_t i = count; i > 1; i--) {
        size_t j = random_below(&seed, i);
        struct pattern last = patterns[i - 1];
        patterns[i - 1] = patterns[j];
        patterns[j] = last;
    }
}

int plan_order(const struct plan *plan, struct pattern **patterns, size_t *count,
               struct nacre_error *error)
{
    static const enum pattern_kind kinds[PATTERN_KINDS] = {PATTERN_WHITE, PATTERN_DOTS,
                                                           PATTERN_BLACK, PATTERN_GRID};
    size_t used = 0;
    size_t total = 0;
    for (int k = 0; k < PATTERN_KINDS; k++) {
        total += (size_t)plan_pattern_count(plan, kinds[k]);
    }
    *count = 0;
    *patterns = calloc(total, sizeof **patterns);
    if (!*patterns) {
        return nacre_fail_memory(error, "the order of patterns");
    }
    for (int k = 0; k < PATTERN_KINDS; k++) {
        size_t first = used;
        for (int n = 0; n < plan_pattern_count(plan, kinds[k]); n++) {
            (*patterns)[used++] = (struct pattern){.kind = kinds[k], .number = n};
        }
        if (kinds[k] == PATTERN_GRID && plan->order == GRID_ORDER_RANDOM) {
            shuffle(*patterns + first, used - first, (uint64_t)plan->seed);
            used = first + (size_t)plan_shown_count(plan, PATTERN_GRID);
        }
    }
    *count = used;
    return NACRE_OK;
}

void plan_pattern_offset(const struct plan *plan, struct pattern pattern, int *x, int *y)
{
    *x = 0;
    *y = 0;
    if (pattern.kind == PATTERN_GRID) {
        *x = pattern.number % plan->grid_spacing;
        *y = pattern.number / plan->grid_spacing;
    } else if (pattern.kind == PATTERN_DOTS) {
        *x = pattern.number % dot_steps(plan) * plan->dot_shift;
        *y = pattern.number / dot_steps(plan) * plan->dot_shift;
    }
}

static void draw_squares(int x0, int y0, int spacing, int side, int width, int height,
                         uint8_t *levels)
{
    for (int y = y0; y + side <= height; y += spacing) {
        for (int x = x0; x + side <= width; x += spacing) {
            for (int row = y; row < y + side; row++) {
                memset(levels + (size_t)row * (size_t)width + x, 255, (size_t)side);
            }
        }
    }
}

/* A grid of regions; the sample lies in the projector's upper left. */
static void draw_points(const struct plan_grids *grids, int grid, int width, int height,
                        uint8_t *levels)
{
    for (uint32_t i = grids->starts[grid]; i < grids->starts[grid + 1]; i++) {
        int x = (int)grids->points[i] % grids->width;
        int y = (int)grids->points[i] / grids->width;
        if (x < width && y < height) {
            levels[(size_t)y * (size_t)width + (size_t)x] = 255;
        }
    }
}

void plan_draw(const struct plan *plan, struct pattern pattern, int width, int height,
               uint8_t *levels)
{
    int x0, y0;
    plan_pattern_offset(plan, pattern, &x0, &y0);
    memset(levels, pattern.kind == PATTERN_WHITE ? 255 : 0, (size_t)width * (size_t)height);
    if (pattern.kind == PATTERN_GRID && plan->region_count) {
        draw_points(plan->grids, pattern.number, width, height, levels);
    } else if (pattern.kind == PATTERN_GRID) {
        draw_squares(x0, y0, plan->grid_spacing, 1, width, height, levels);
    } else if (pattern.kind == PATTERN_DOTS) {
        draw_squares(x0, y0, plan->dot_spacing, plan->dot_size, width, height, levels);
    }
}
