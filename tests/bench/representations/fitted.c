/* Making materials and measuring what they take. */
#include "fitted.h"

#include "quantise.h"

#include "../timing.h"

#include "nacre/evaluate.h"
#include "tests/files.h"

#include <stdlib.h>
#include <sys/stat.h>

struct nacre_material fitted_material(const struct bench *b, const struct sample *s, bool kept,
                                      const struct factor_options *options)
{
    struct nacre_error error = {0};
    struct nacre_material material = {0};
    struct factor_summary summary = {0};
    if (factorize_responses(kept ? &s->kept : &s->responses, s->pitch_mm, options, &b->opencl, NULL,
                            &material, &summary, &error) != NACRE_OK) {
        fail(error.text);
    }
    factor_summary_finish(&summary);
    return material;
}

struct factor_options fitted_paper(int terms, int clusters, enum factor_weight weight)
{
    struct factor_options options = factor_options_default();
    options.terms = terms;
    options.clusters = clusters;
    options.weight = weight;
    options.store = FACTOR_STORE_FLOAT;
    return options;
}

/* All responses of a material. */
static float *predict(const struct sample *s, const struct nacre_material *m)
{
    float *model = allocate(sample_size(s) * sizeof *model);
#pragma omp parallel for schedule(dynamic)
    for (int i = 0; i < s->width * s->height; i++) {
        nacre_material_response(m, i % s->width, i / s->width,
                                model + (size_t)i * sample_response_size(s));
    }
    return model;
}

static size_t file_bytes(const struct nacre_material *m)
{
    struct nacre_error error = {0};
    struct stat status;
    char *folder = folder_make(), *path = path_join(folder, "material.exr");
    if (nacre_material_write(path, m, &error) != NACRE_OK) {
        fail(error.text);
    }
    if (stat(path, &status) != 0) {
        fail("cannot look at the material's file");
    }
    free(path);
    folder_remove(folder);
    return (size_t)status.st_size;
}

struct fitted fitted_tell(const struct sample *s, struct nacre_material *full,
                          struct nacre_material *kept, int bits)
{
    for (int i = 0; i < 2; i++) {
        struct nacre_material *m = i == 0 ? full : kept;
        if (bits && m) {
            quantise_material(m, bits);
            m->pixel = NACRE_HALF;
            nacre_material_round(m);
        }
    }
    return (struct fitted){.model = predict(s, full),
                           .of_kept = kept ? predict(s, kept) : NULL,
                           .bytes = nacre_material_size(full),
                           .file = file_bytes(full),
                           .steps = full->iterations};
}

void fitted_finish(struct fitted *fitted)
{
    free(fitted->model);
    free(fitted->of_kept);
    *fitted = (struct fitted){0};
}
