/* Which surface points each grid of a plan lights, and how many of the plan's exposures it gets. */
#include "rig/plan_grids.h"

#include "rig/plan.h"

#include <stdbool.h>
#include <stdlib.h>

/* A point that waits to be put into a grid. */
struct candidate {
    uint32_t point;
    uint16_t spacing, exposures;
};

enum { NONE = UINT32_MAX };

/* What points are laid into. A grid's points are listed by square cells as wide as the widest spacing, so that what could
 * be too near lies in the same cell or one beside it. */
struct layout {
    struct plan_grids *grids;
    struct candidate *candidates; /* [points] */
    int side, across, down;       /* of the cells */
    uint32_t *heads;     /* [capacity][down][across]: the first point of a grid in a cell */
    uint32_t *next;      /* [points]: in the same cell */
    uint16_t *exposures; /* of a grid so far */
    int capacity;
};

static size_t points_of(const struct plan_grids *grids)
{
    return (size_t)grids->width * (size_t)grids->height;
}

/* The region that holds a point: of several the last; NULL: none. */
static const struct plan_region *region_of(const struct plan *plan, int x, int y)
{
    for (size_t i = plan->region_count; i > 0; i--) {
        const struct plan_region *region = &plan->regions[i - 1];
        if (x >= region->x && y >= region->y && x - region->x < region->width &&
            y - region->y < region->height) {
            return region;
        }
    }
    return NULL;
}

static uint16_t exposures_of(const struct plan *plan, const struct plan_region *region)
{
    size_t count = 1;
    if (!region || region->longest_turns <= 0) {
        return (uint16_t)plan->exposure_count;
    }
    while (count < plan->exposure_count && plan->exposure_turns[count] <= region->longest_turns) {
        count++;
    }
    return (uint16_t)count;
}

static int by_need(const void *a, const void *b)
{
    const struct candidate *p = a;
    const struct candidate *q = b;
    if (p->spacing != q->spacing) {
        return p->spacing > q->spacing ? -1 : 1;
    }
    if (p->exposures != q->exposures) {
        return p->exposures > q->exposures ? -1 : 1;
    }
    return p->point < q->point ? -1 : p->point > q->point;
}

/* Room for more grids. */
static int reserve(struct layout *layout, int capacity, struct nacre_error *error)
{
    size_t cells = (size_t)layout->across * (size_t)layout->down;
    uint32_t *heads = realloc(layout->heads, ((size_t)capacity * cells + 1) * sizeof *heads);
    if (!heads) {
        (void)nacre_fail_memory(error, "the grids of a plan");
        return NACRE_FAILED;
    }
    layout->heads = heads;
    for (size_t i = (size_t)layout->capacity * cells; i < (size_t)capacity * cells; i++) {
        heads[i] = NONE;
    }
    layout->capacity = capacity;
    return NACRE_OK;
}

static uint32_t *head_of(const struct layout *layout, int grid, int column, int row)
{
    return &layout->heads[((size_t)grid * (size_t)layout->down + (size_t)row) *
                              (size_t)layout->across +
                          (size_t)column];
}

/* Whether a cell has a point whose own surroundings, as wide as its spacing, would overlap with the candidate's. */
static bool cell_is_free(const struct layout *layout, int grid, int column, int row,
                         const struct candidate *candidate)
{
    const struct plan_grids *grids = layout->grids;
    for (uint32_t i = *head_of(layout, grid, column, row); i != NONE; i = layout->next[i]) {
        int across = abs((int)(i % (uint32_t)grids->width) -
                         (int)(candidate->point % (uint32_t)grids->width));
        int down = abs((int)(i / (uint32_t)grids->width) -
                       (int)(candidate->point / (uint32_t)grids->width));
        if (2 * (across > down ? across : down) < grids->spacings[i] + candidate->spacing) {
            return false;
        }
    }
    return true;
}

static bool has_room(const struct layout *layout, int grid, const struct candidate *candidate)
{
    int column = (int)candidate->point % layout->grids->width / layout->side;
    int row = (int)candidate->point / layout->grids->width / layout->side;
    for (int r = row > 0 ? row - 1 : 0; r <= row + 1 && r < layout->down; r++) {
        for (int c = column > 0 ? column - 1 : 0; c <= column + 1 && c < layout->across; c++) {
            if (!cell_is_free(layout, grid, c, r, candidate)) {
                return false;
            }
        }
    }
    return true;
}

static void put(const struct layout *layout, int grid, const struct candidate *candidate)
{
    uint32_t *head =
        head_of(layout, grid, (int)candidate->point % layout->grids->width / layout->side,
                (int)candidate->point / layout->grids->width / layout->side);
    layout->next[candidate->point] = *head;
    *head = candidate->point;
    layout->grids->grid_of[candidate->point] = (uint32_t)grid;
    if (candidate->exposures > layout->exposures[grid]) {
        layout->exposures[grid] = candidate->exposures;
    }
}

/* The first grid with room for a point, of those that are exposed as long as it asks or of all; else their count. */
static int first_room(const struct layout *layout, const struct candidate *candidate, bool exposed)
{
    int grid = 0;
    while (grid < layout->grids->count &&
           ((exposed && layout->exposures[grid] < candidate->exposures) ||
            !has_room(layout, grid, candidate))) {
        grid++;
    }
    return grid;
}

/* The grid for a point: its place in the lattice of its own spacing, which leaves no gaps within a region; where that is
 * taken, one that is exposed long enough anyway, or any. */
static int find_room(const struct layout *layout, const struct candidate *candidate)
{
    int width = layout->grids->width;
    int x = (int)candidate->point % width % candidate->spacing;
    int y = (int)candidate->point / width % candidate->spacing;
    int grid = y * candidate->spacing + x;
    if (!has_room(layout, grid, candidate)) {
        grid = first_room(layout, candidate, true);
    }
    return grid < layout->grids->count ? grid : first_room(layout, candidate, false);
}

static int lay(struct layout *layout, struct nacre_error *error)
{
    struct plan_grids *grids = layout->grids;
    size_t count = points_of(grids);
    qsort(layout->candidates, count, sizeof *layout->candidates, by_need);
    layout->side = layout->candidates[0].spacing;
    layout->across = (grids->width - 1) / layout->side + 1;
    layout->down = (grids->height - 1) / layout->side + 1;
    grids->count = layout->side * layout->side;
    /* No point opens more than one grid. */
    layout->exposures = calloc((size_t)grids->count + count, sizeof *layout->exposures);
    layout->next = calloc(count + 1, sizeof *layout->next);
    if (!layout->exposures || !layout->next) {
        (void)nacre_fail_memory(error, "the grids of a plan");
        return NACRE_FAILED;
    }
    int status = reserve(layout, grids->count, error);
    if (status != NACRE_OK) {
        return status;
    }
    for (size_t i = 0; i < count; i++) {
        const struct candidate *candidate = &layout->candidates[i];
        int grid = find_room(layout, candidate);
        if (grid == layout->capacity) {
            status = reserve(layout, 2 * layout->capacity, error);
            if (status != NACRE_OK) {
                return status;
            }
        }
        grids->count += grid == grids->count;
        put(layout, grid, candidate);
    }
    return NACRE_OK;
}

/* Lists of points by grid, from the grids by point. */
static int list_points(const struct layout *layout, struct nacre_error *error)
{
    struct plan_grids *grids = layout->grids;
    size_t points = points_of(grids);
    grids->starts = calloc((size_t)grids->count + 2, sizeof *grids->starts);
    grids->exposures = calloc((size_t)grids->count + 1, sizeof *grids->exposures);
    if (!grids->starts || !grids->exposures) {
        return nacre_fail_memory(error, "the grids of a plan");
    }
    uint32_t *next = grids->starts + 1; /* ends up as the starts themselves */
    for (size_t i = 0; i < points; i++) {
        next[grids->grid_of[i] + 1]++;
    }
    for (int g = 0; g < grids->count; g++) {
        next[g + 1] += next[g];
    }
    for (uint32_t i = 0; i < points; i++) {
        grids->places[i] = next[grids->grid_of[i]]++;
        grids->points[grids->places[i]] = i;
    }
    return NACRE_OK;
}

static void fill_exposures(const struct layout *layout)
{
    struct plan_grids *grids = layout->grids;
    for (size_t i = 0; i < points_of(grids); i++) {
        const struct candidate *candidate = &layout->candidates[i];
        uint16_t *exposures = &grids->exposures[layout->grids->grid_of[candidate->point]];
        *exposures = candidate->exposures > *exposures ? candidate->exposures : *exposures;
    }
}

/* Points, their regions, and without regions their grids. */
static void fill(const struct plan *plan, const struct layout *layout)
{
    struct plan_grids *grids = layout->grids;
    for (int y = 0; y < grids->height; y++) {
        for (int x = 0; x < grids->width; x++) {
            size_t at = (size_t)y * (size_t)grids->width + (size_t)x;
            const struct plan_region *region = region_of(plan, x, y);
            int spacing = region ? region->spacing : plan->grid_spacing;
            grids->spacings[at] = (uint16_t)spacing;
            layout->candidates[at] =
                (struct candidate){(uint32_t)at, (uint16_t)spacing, exposures_of(plan, region)};
            grids->grid_of[at] =
                (uint32_t)(y % plan->grid_spacing * plan->grid_spacing + x % plan->grid_spacing);
        }
    }
}

int plan_grids_new(const struct plan *plan, int width, int height, struct plan_grids **grids,
                   struct nacre_error *error)
{
    struct layout layout = {.grids = calloc(1, sizeof *layout.grids)};
    size_t points = (size_t)width * (size_t)height;
    int status = NACRE_OK;
    *grids = NULL;
    layout.candidates = calloc(points + 1, sizeof *layout.candidates);
    if (layout.grids) {
        layout.grids->width = width;
        layout.grids->height = height;
        layout.grids->points = calloc(points + 1, sizeof *layout.grids->points);
        layout.grids->grid_of = calloc(points + 1, sizeof *layout.grids->grid_of);
        layout.grids->places = calloc(points + 1, sizeof *layout.grids->places);
        layout.grids->spacings = calloc(points + 1, sizeof *layout.grids->spacings);
    }
    if (!layout.grids || !layout.candidates || !layout.grids->points || !layout.grids->grid_of ||
        !layout.grids->places || !layout.grids->spacings) {
        status = nacre_fail_memory(error, "the grids of a plan");
        goto out;
    }
    fill(plan, &layout);
    if (plan->region_count) {
        status = lay(&layout, error);
    } else {
        layout.grids->count = plan->grid_spacing * plan->grid_spacing;
    }
    if (status == NACRE_OK) {
        status = list_points(&layout, error);
    }
    if (status == NACRE_OK) {
        fill_exposures(&layout);
        for (int g = 0; g < layout.grids->count; g++) { /* those beyond a small sample's points */
            layout.grids->exposures[g] += layout.grids->exposures[g] == 0;
        }
        *grids = layout.grids;
        layout.grids = NULL;
    }
out:
    free(layout.heads);
    free(layout.next);
    free(layout.exposures);
    free(layout.candidates);
    plan_grids_free(layout.grids);
    return status;
}

void plan_grids_free(struct plan_grids *grids)
{
    if (grids) {
        free(grids->starts);
        free(grids->points);
        free(grids->grid_of);
        free(grids->places);
        free(grids->exposures);
        free(grids->spacings);
        free(grids);
    }
}
