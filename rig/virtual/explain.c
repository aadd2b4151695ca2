/* Listing the effects of a sample file. */
#include "rig/virtual/explain.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

enum { FIXED_EFFECTS = 12 + SOLVERS };

/* Measured on one 2 to 3 GHz core: a voxel for 8 responses, and finding the material of one place. */
static const double VOXEL_SECONDS = 200e-9;
static const double PLACE_SECONDS = 100e-9;
static const int PLACES_IN_VOXEL = 32;

struct list {
    const struct sample *sample;
    struct effect *effects;
    size_t count;
};

__attribute__((format(printf, 6, 7))) static void add(struct list *list, const char *name,
                                                      bool simulated, int line, double seconds,
                                                      const char *format, ...)
{
    struct effect *effect = &list->effects[list->count++];
    va_list arguments;
    va_start(arguments, format);
    (void)snprintf(effect->name, sizeof effect->name, "%s", name); /* a cut name still helps */
    (void)vsnprintf(effect->reason, sizeof effect->reason, format, arguments);
    va_end(arguments);
    effect->simulated = simulated;
    effect->line = line;
    effect->seconds = seconds;
}

double explain_diffusion_seconds(const struct transport *transport, int window)
{
    struct transport_facts facts = transport_facts(transport);
    double batches = 2 * ceil(facts.width / 4.0) * ceil(facts.height / 4.0);
    double voxels = 0;
    for (int c = 0; c < 3; c++) {
        double side = (window + 2.0 * transport_reach(transport, window, c) + 4) * facts.subdivide;
        voxels += fmin(side, facts.voxels[0]) * fmin(side, facts.voxels[1]) * facts.voxels[2];
    }
    return batches * voxels * VOXEL_SECONDS;
}

/* The first material for which some channel fulfils the test. */
static const struct sample_material *find(const struct sample *sample,
                                          bool (*test)(const struct sample_material *, int channel))
{
    for (size_t i = 0; i < sample->material_count; i++) {
        for (int c = 0; c < 3; c++) {
            if (test(&sample->materials[i], c)) {
                return &sample->materials[i];
            }
        }
    }
    return NULL;
}

static bool scatters(const struct sample_material *material, int channel)
{
    return material->scattering_per_mm[channel] > 0;
}

static bool absorbs(const struct sample_material *material, int channel)
{
    return material->absorption_per_mm[channel] > 0;
}

static bool is_directed(const struct sample_material *material, int channel)
{
    return material->anisotropy[channel] != 0;
}

static bool refracts(const struct sample_material *material, int channel)
{
    return channel == 0 && material->index > 1;
}

static int first_line(int a, int b)
{
    return a ? a : b;
}

/* The solvers: the chosen one with what calls for it, the others with what speaks against them. */
static void add_solvers(struct list *list, const struct transport_facts *facts,
                        const struct solver_choice *choice)
{
    const struct sample_material *found = find(list->sample, scatters);
    int line = found ? first_line(found->scattering_line, found->albedo_line) : 0;
    if (!found) {
        add(list, "multiple scattering", false, 0, 0, "no material scatters: all responses are 0");
        return;
    }
    add(list, "multiple scattering", true, line, 0, "by %s, error of a response about %.2g",
        solver_name(choice->solver), choice->options[choice->solver].error);
    for (int i = 0; i < SOLVERS; i++) {
        const struct solver_option *option = &choice->options[i];
        bool chosen = choice->solver == (enum solver)i;
        if (!chosen) {
            add(list, solver_name((enum solver)i), false, 0, option->seconds, "%s", option->reason);
        } else if (i == SOLVER_DIFFUSION) {
            add(list, solver_name(SOLVER_DIFFUSION), true, line, option->seconds,
                "%d x %d x %d voxels of %.3g mm, %.3g to %.3g mm high", facts->voxels[0],
                facts->voxels[1], facts->voxels[2], facts->cell_mm, facts->first_mm,
                facts->last_mm);
        } else if (i == SOLVER_MONTECARLO) {
            add(list, solver_name(SOLVER_MONTECARLO), true, line, option->seconds,
                "%llu paths a point and channel", (unsigned long long)choice->paths);
        } else {
            add(list, solver_name(SOLVER_CLOSED), true, line, option->seconds,
                "the slab is homogeneous and its sides are far");
        }
    }
}

/* List it as forbidden if it is. */
static bool add_forbidden(struct list *list, const char *name)
{
    bool forbidden = sample_forbids(list->sample, name);
    if (forbidden) {
        add(list, name, false, list->sample->without_line, 0, "without forbids it");
    }
    return forbidden;
}

static void add_absorption(struct list *list)
{
    const struct sample_material *found = find(list->sample, absorbs);
    add(list, SAMPLE_ABSORPTION, found,
        found ? first_line(found->absorption_line, found->albedo_line) : 0, 0, "%s",
        found ? "in the same equations" : "no material absorbs");
}

static void add_media(struct list *list, enum solver solver)
{
    const struct sample_material *found = find(list->sample, is_directed);
    if (!add_forbidden(list, SAMPLE_ABSORPTION)) {
        add_absorption(list);
    }
    if (add_forbidden(list, SAMPLE_DIRECTED)) {
        return;
    }
    if (found) {
        add(list, SAMPLE_DIRECTED, true, found->anisotropy_line, 0, "%s",
            solver == SOLVER_MONTECARLO ? "by the phase function of Henyey and Greenstein"
                                        : "only as reduced scattering (1 - g) sigma_s; the shape "
                                          "of the phase function is not");
    } else {
        add(list, SAMPLE_DIRECTED, false, 0, 0, "every material scatters evenly (g = 0)");
    }
}

static void add_boundaries(struct list *list, enum solver solver)
{
    const struct sample *sample = list->sample;
    const struct sample_material *found = find(sample, refracts);
    if (add_forbidden(list, SAMPLE_INSIDE)) {
        found = NULL;
    } else if (found) {
        add(list, SAMPLE_INSIDE, true, found->index_line, 0,
            "%s, from the Fresnel formulas for index %.3g",
            solver == SOLVER_MONTECARLO ? "path by path" : "in the boundary condition",
            found->index);
    } else {
        add(list, SAMPLE_INSIDE, false, 0, 0, "every index is 1");
    }
    bool differ = false;
    for (size_t i = 1; i < sample->material_count; i++) {
        differ = differ || sample->materials[i].index != sample->materials[0].index;
    }
    add(list, "refraction between materials", false, differ && found ? found->index_line : 0, 0,
        "%s",
        differ ? "no solver has it; the indices count at the slab's outside alone"
               : "all materials have the same index");
    add(list, "light lost through the bottom", true, sample->thickness_line, 0,
        "the slab is %.4g mm thick and open below", sample->thickness_mm);
    add(list, "light lost through the sides", solver != SOLVER_CLOSED, sample->margin_line, 0,
        solver != SOLVER_CLOSED ? "the slab ends %d points beyond the sample"
                                : "the slab ends %d points beyond the sample, too far to matter",
        sample->margin_points);
    add(list, "local reflection", false, sample->surface.line, 0, "%s",
        sample->surface.line ? "a scan holds what passed through the sample; `nacre scan` has it"
                             : "the surface is polished and mirrors past the camera");
    add(list, "dust", false, sample->dust.line, 0, "%s",
        sample->dust.line ? "a scan is of the clean sample; `nacre scan` has it"
                          : "none lies on the sample");
    add(list, "direction of light near the surface", solver == SOLVER_MONTECARLO, 0, 0, "%s",
        solver == SOLVER_MONTECARLO
            ? "every path has its own"
            : "diffusion keeps the mean direction only: some per cent within a mean free path");
}

static void add_inclusions(struct list *list, const struct transport_facts *facts)
{
    const struct sample *sample = list->sample;
    double places =
        (double)facts->voxels[0] * facts->voxels[1] * facts->voxels[2] * PLACES_IN_VOXEL;
    if (add_forbidden(list, SAMPLE_HETEROGENEITY)) {
        return;
    }
    if (sample->inclusion_count == 0) {
        add(list, SAMPLE_HETEROGENEITY, false, 0, 0, "there are no inclusions");
    } else {
        add(list, SAMPLE_HETEROGENEITY, true, sample->inclusions[0].line, 0,
            "%zu inclusions: every voxel has its own coefficients", sample->inclusion_count);
    }
    for (size_t i = 0; i < sample->inclusion_count; i++) {
        const struct sample_inclusion *inclusion = &sample->inclusions[i];
        char name[48];
        (void)snprintf(name, sizeof name, "%s of %s", sample_shape_name(inclusion),
                       inclusion->material);
        add(list, name, true, inclusion->line, places * PLACE_SECONDS, "%s%s%s",
            "painted into the voxels by its share of each",
            inclusion->wander_mm > 0 ? ", wandering" : "",
            inclusion->lean[0] != 0 || inclusion->lean[1] != 0 ? ", leaning" : "");
    }
}

int explain_effects(const struct sample *sample, const struct transport *transport,
                    const struct solver_choice *choice, struct effect **effects, size_t *count,
                    struct nacre_error *error)
{
    struct list list = {.sample = sample};
    struct transport_facts facts = transport_facts(transport);
    list.effects = calloc(FIXED_EFFECTS + sample->inclusion_count, sizeof *list.effects);
    if (!list.effects) {
        return nacre_fail_memory(error, "the list of effects");
    }
    add_solvers(&list, &facts, choice);
    add_media(&list, choice->solver);
    add_boundaries(&list, choice->solver);
    add_inclusions(&list, &facts);
    *effects = list.effects;
    *count = list.count;
    return NACRE_OK;
}
