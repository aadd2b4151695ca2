/* Prints docs/stability.md: each hard case with its bounds and what was measured. */
#include "run.h"

#include <math.h>
#include <stdio.h>
#include <unity.h>

static struct opencl opencl;

void setUp(void)
{
}

void tearDown(void)
{
}

static const char text[] =
    "# Hard cases\n\n"
    "What `tests/hard` runs through clustering, kernels, both methods, responses held as floats "
    "and as half floats, and "
    "the\nmaterial file, and how it stood on this machine. Made by `build/tests/hard/stability > "
    "docs/stability.md` on "
    "%s.\n\n"
    "Each case must show: no NaN or infinity; F, H >= 0; the same bits for the same seed; and "
    "these bounds, of `hals` / "
    "`mu`,\nthe worse of floats and half floats:\n\n"
    "- **rise**: of the objective in any step, summed in double precision from the factors, "
    "relative: at most 1e-6 (and "
    "1e-12\n  of the responses' energy, which is single precision's noise).\n"
    "- **device**: what the device calls the objective, against that sum: at most 1e-5 of it and "
    "1e-10 of the energy. The "
    "share\n  of this that was used.\n"
    "- **double**: the objective after all steps against that of the same method in double "
    "precision, relative: at most "
    "1e-3\n  above it with `hals`, within 1e-4 of it with `mu`, or both below 1e-12 of the energy "
    "(*).\n"
    "- **error**: the mean relative error of the material as read back from its file, F and H as "
    "half floats.\n\n"
    "Steps are 40 unless it is said. A missing entry influences nothing, whatever bits stand in "
    "its place in the working "
    "buffers;\npowers of two as scale factors, from 2^-100 to 2^100, change no bit of F and H; "
    "other scale factors, from "
    "1e-30 to 1e30,\nchange the error by less than 1e-5 of itself. The updates agree with dense, "
    "general weighted "
    "non-negative matrix\nfactorization (section 5.3 before W is chosen) to 1e-10 in double "
    "precision and to 1e-4 on the "
    "device.\n\n"
    "| case | what is hard | rise | device | double | error |\n| --- | --- | --- | --- | --- | --- "
    "|\n";

/* The difference from double precision, relative where it is above the noise. */
static void print_difference(const struct hard_figures *f)
{
    if (fmax(f->reference, f->objective) <= hard_noise() * f->energy + 1e-30) {
        printf(" *");
    } else {
        printf(" %+.0e", f->objective / f->reference - 1);
    }
}

static double error_of(const struct hard_case *hard, enum factor_method method)
{
    struct sample sample = hard_sample(hard);
    struct nacre_material material = {0};
    struct factor_summary summary = {0};
    hard_material(&sample, hard, &opencl, (struct hard_how){.method = method}, FACTOR_STORE_HALF,
                  &material, &summary);
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

static void print_case(const struct hard_case *hard)
{
    struct hard_figures of[2];
    for (int m = 0; m < 2; m++) {
        struct hard_how how = {.method = m ? FACTOR_METHOD_MU : FACTOR_METHOD_HALS};
        struct hard_figures floats = hard_run(hard, &opencl, how);
        how.half = true;
        of[m] = worse(floats, hard_run(hard, &opencl, how));
    }
    printf("| %s | %s |", hard->name, hard->what);
    printf(" %.1g / %.1g |", of[0].rise, of[1].rise);
    printf(" %.2f / %.2f |", of[0].device, of[1].device);
    print_difference(&of[0]);
    printf(" /");
    print_difference(&of[1]);
    printf(" |");
    printf(" %.4f / %.4f |\n", error_of(hard, FACTOR_METHOD_HALS),
           error_of(hard, FACTOR_METHOD_MU));
}

static void print_table(void)
{
    printf(text, opencl.name);
    for (size_t i = 0; i < hard_case_count; i++) {
        print_case(&hard_cases[i]);
    }
}

int main(void)
{
    struct nacre_error error = {0};
    if (opencl_open(NULL, &opencl, &error) != NACRE_OK) {
        (void)fprintf(stderr, "%s\n", error.text);
        return 1;
    }
    /* Of what fails, nothing but a table cut short would tell. */
    print_table();
    opencl_close(&opencl);
    return 0;
}
