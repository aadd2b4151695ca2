/* Packing the terms of a grey material. */
#include "render/grey.h"

#include <stdlib.h>

/* from[texel][channel][terms], of which the first channel counts, to out[texel][3][packed] */
static float *pack_factors(const struct appearance *appearance, const float *from, size_t packed)
{
    size_t texels = (size_t)appearance->width * (size_t)appearance->height;
    size_t terms = (size_t)appearance->terms;
    size_t step = (size_t)appearance->factor_channels * terms;
    float *out = calloc(texels * 3 * packed, sizeof *out);
    for (size_t i = 0; out && i < texels; i++) {
        for (size_t t = 0; t < terms; t++) {
            out[(i * 3 + t % 3) * packed + t / 3] = from[i * step + t];
        }
    }
    return out;
}

/* The same of a kernel per term: [side][side][terms][4] to [side][side][packed][4] */
static float *pack_kernels(const struct appearance *appearance, size_t packed)
{
    size_t side = (size_t)appearance->window + 2, terms = (size_t)appearance->terms;
    float *out = calloc(side * side * packed * 4, sizeof *out);
    for (size_t i = 0; out && i < side * side; i++) {
        for (size_t t = 0; t < terms; t++) {
            out[(i * packed + t / 3) * 4 + t % 3] = appearance->kernels[(i * terms + t) * 4];
        }
    }
    return out;
}

int grey_pack(struct appearance *appearance, struct nacre_error *error)
{
    bool per_term = appearance->layout == NACRE_KERNEL_PER_TERM, own_h;
    size_t packed = ((size_t)appearance->terms + 11) / 12 * 4; /* a multiple of 4 */
    float *f = NULL, *h = NULL, *kernels = NULL;
    int status = NACRE_FAILED;
    if (packed >= (size_t)appearance->terms) {
        return NACRE_OK;
    }
    own_h = appearance->h != appearance->f;
    f = pack_factors(appearance, appearance->f, packed);
    h = own_h ? pack_factors(appearance, appearance->h, packed) : f;
    kernels = per_term ? pack_kernels(appearance, packed) : appearance->kernels;
    if (!f || !h || !kernels) {
        (void)nacre_fail_memory(error, "the material");
        goto out;
    }
    if (own_h) {
        free(appearance->h);
    }
    free(appearance->f);
    appearance->f = f;
    appearance->h = h;
    if (per_term) {
        free(appearance->kernels);
        appearance->kernels = kernels;
        appearance->kernel_count = (appearance->kernel_count + 2) / 3;
    }
    appearance->terms = (int)packed;
    appearance->factor_channels = 3;
    appearance->packed = true;
    basis_finish(&appearance->basis);
    return basis_make(&appearance->basis, appearance, error);
out:
    free(h == f ? NULL : h);
    free(f);
    free(per_term ? kernels : NULL);
    return status;
}

void grey_unpack(float (*gathered)[3], size_t count, float (*radiosity)[3])
{
    for (size_t i = 0; i < count; i++) {
        float sum = gathered[i][0] + gathered[i][1] + gathered[i][2];
        for (int c = 0; c < 3; c++) {
            radiosity[i][c] += sum;
        }
    }
}
