/* Prints docs/stability.md: each hard case with its bounds and what was measured. */
#include "run.h"
#include "terms_run.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

static struct opencl opencl;

void setUp(void)
{
}

void tearDown(void)
{
}

static const char *const text[] = {
    "# Hard cases",
    "",
    "What `tests/hard` runs through clustering, kernels, both methods, both weights, responses",
    "held as floats and as half floats, and the material file, and how it stood. Made by",
    "",
    "    build/tests/hard/stability > docs/stability.md",
    "",
    "Each case must show: no NaN or infinity; F, H >= 0; the same bits for the same seed; and",
    "these bounds, of `hals` / `mu`, the worse of floats and half floats:",
    "",
    "- **rise**: of the objective in any step, summed in double precision from the factors,",
    "  relative: at most 1e-6 (and 1e-12 of the responses' energy, single precision's noise).",
    "- **device**: what the device calls the objective, against that sum: at most 1e-5 of it",
    "  and 1e-10 of the energy. The share of this that was used.",
    "- **double**: the objective after all steps against that of the same method in double",
    "  precision, relative: at most 1e-3 above it with `hals`, within 1e-4 of it with `mu`, or",
    "  both below 1e-12 of the energy (*). Where windows are wider than 7, `hals` takes normal",
    "  matrices of cells, which double precision does not, and may be far below.",
    "- **error**: the mean relative error of the material as read back from its file, F and H",
    "  as half floats.",
    "",
    "Steps are 40 unless it is said. A missing entry influences nothing, whatever bits stand in",
    "its place in the working buffers; powers of two as scale factors, from 2^-100 to 2^100,",
    "change no bit of F and H; other scale factors, from 1e-30 to 1e30, change the error by",
    "less than 1e-5 of itself. The updates agree with dense, general weighted non-negative",
    "matrix factorization (section 5.3 before W is chosen) to 1e-10 in double precision and to",
    "1e-4 on the device.",
};

/* The difference from double precision, relative where it is above the noise. */
static void print_difference(const struct hard_figures *f)
{
    if (fmax(f->reference, f->objective) <= hard_noise() * f->energy + 1e-30) {
        printf(" *");
    } else {
        printf(" %+.0e", f->objective / f->reference - 1);
    }
}

static double error_of(const struct hard_case *hard, struct hard_how how)
{
    struct sample sample = hard_sample(hard);
    struct nacre_material material = {0};
    struct factor_summary summary = {0};
    hard_material(&sample, hard, &opencl, how, FACTOR_STORE_HALF, &material, &summary);
    double mean = summary.error.whole.mean;
    factor_summary_finish(&summary);
    nacre_material_finish(&material);
    sample_finish(&sample);
    return mean;
}

static struct hard_figures worse(struct hard_figures a, struct hard_figures b)
{
    struct hard_figures worst =
        fabs(a.objective / a.reference - 1) >= fabs(b.objective / b.reference - 1) ? a : b;
    worst.rise = fmax(a.rise, b.rise);
    worst.device = fmax(a.device, b.device);
    return worst;
}

static void print_case(const struct hard_case *hard, enum factor_weight weight)
{
    struct hard_figures of[2];
    double errors[2];
    for (int m = 0; m < 2; m++) {
        struct hard_how how = {m ? FACTOR_METHOD_MU : FACTOR_METHOD_HALS, weight, .half = false};
        struct hard_figures floats = hard_run(hard, &opencl, how);
        errors[m] = error_of(hard, how);
        how.half = true;
        of[m] = worse(floats, hard_run(hard, &opencl, how));
    }
    printf("| %s |", hard->name);
    if (weight == FACTOR_WEIGHT_KERNEL) {
        printf(" %s |", hard->what);
    }
    printf(" %.1g / %.1g | %.2f / %.2f |", of[0].rise, of[1].rise, of[0].device, of[1].device);
    print_difference(&of[0]);
    printf(" /");
    print_difference(&of[1]);
    printf(" | %.4f / %.4f |\n", errors[0], errors[1]);
    (void)fflush(stdout);
}

/* Relative errors are of all channels together, which the check in double precision is not; ten thousand steps once are
 * enough. */
static bool is_shown(const struct hard_case *hard, enum factor_weight weight)
{
    return weight == FACTOR_WEIGHT_KERNEL || (hard->channels == 1 && hard_steps(hard) <= 100);
}

static void print_table(enum factor_weight weight)
{
    bool kernel = weight == FACTOR_WEIGHT_KERNEL;
    printf("\n## Weight %s\n\n", kernel ? "1 / sqrt(g), the paper's" : "1 / ||R_i||");
    printf("| case |%s rise | device | double | error |\n", kernel ? " what is hard |" : "");
    printf("| --- |%s --- | --- | --- | --- |\n", kernel ? " --- |" : "");
    for (size_t i = 0; i < hard_case_count; i++) {
        if (is_shown(&hard_cases[i], weight)) {
            print_case(&hard_cases[i], weight);
        }
    }
}

static const char *const text_of_terms[] = {
    "",
    "## A kernel per term",
    "",
    "The same cases with a kernel for each of as many terms, radial, planes shared by the "
    "channels, what is reciprocal found",
    "by the program; responses as floats; 40 steps each. No number is NaN, infinite or negative.",
    "",
    "- **rise** and **device** as above: the sum in double precision is made entry by entry from "
    "planes and kernels.",
    "- **kernels**: how far they are from the best for their planes, by sums in double precision: "
    "the objective's change with a",
    "  kernel's size, over the root of its energy and the responses', at the last step: at most "
    "1e-5.",
    "- **energy**: the objective over that of no model.",
    "- **error**: the mean relative error of the material as read back from its file, planes of 8 "
    "bits / as half floats.",
    "",
    "| case | rise | device | kernels | energy | error |",
    "| --- | --- | --- | --- | --- | --- |",
};

static double error_with_bits(const struct hard_case *hard, int bits)
{
    struct nacre_material material = {0};
    struct factor_summary summary = {0};
    hard_terms_material(hard, bits, &opencl, &material, &summary);
    double mean = summary.error.whole.mean;
    factor_summary_finish(&summary);
    nacre_material_finish(&material);
    return mean;
}

static void print_terms(void)
{
    for (size_t i = 0; i < sizeof text_of_terms / sizeof *text_of_terms; i++) {
        (void)puts(text_of_terms[i]);
    }
    for (size_t i = 0; i < hard_case_count; i++) {
        const struct hard_case *hard = &hard_cases[i];
        struct hard_terms_figures f = hard_terms_run(hard, &opencl, HARD_AS_FOUND, 0, 0);
        printf("| %s | %.1g | %.2f | %.0e | %.2g | %.4f / %.4f |\n", hard->name, f.rise, f.device,
               f.slope, f.energy > 0 ? f.objective / f.energy : 0, error_with_bits(hard, 8),
               error_with_bits(hard, 0));
        (void)fflush(stdout);
    }
}

/* Argument: terms, for the table of a kernel per term alone. */
int main(int argc, char **argv)
{
    struct nacre_error error = {0};
    if (opencl_open(NULL, &opencl, &error) != NACRE_OK) {
        (void)fprintf(stderr, "%s\n", error.text);
        return 1;
    }
    if (argc > 1 && strcmp(argv[1], "terms") == 0) {
        print_terms();
        opencl_close(&opencl);
        return 0;
    }
    for (size_t i = 0; i < sizeof text / sizeof *text; i++) {
        (void)puts(text[i]);
    }
    printf("\nMeasured on %s.\n", opencl.name);
    /* Of what fails, nothing but a table cut short would tell. */
    print_table(FACTOR_WEIGHT_KERNEL);
    print_table(FACTOR_WEIGHT_RESPONSE);
    print_terms();
    opencl_close(&opencl);
    return 0;
}
