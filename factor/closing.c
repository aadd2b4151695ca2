/* What closes a factorization. */
#include "factor/closing.h"

#include "factor/assemble.h"
#include "factor/terms_material.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Bits suffice where the error of rounded planes is at most so many times that of fitted ones, or more by so little. Two bits
 * more are a quarter of the planes' bytes, which as terms take about as much off the error. */
#define MOST_ROUNDED   1.25
#define LEAST_ROUNDING 5e-4

/* Where they are yet to be chosen, as many as they mostly are. */
static int bits_of(const struct factor_options *o)
{
    return o->bits == FACTOR_BITS_AUTO ? FACTOR_BITS_LEAST : o->bits;
}

static int allocate(const struct factor_options *o, double pitch_mm, const struct problem *p,
                    struct nacre_material *m, struct nacre_error *error)
{
    const struct responses *r = p->responses;
    if (p->data) {
        return terms_material_allocate(o->seed, bits_of(o), pitch_mm, p, m, error);
    }
    *m = (struct nacre_material){.width = r->width,
                                 .height = r->height,
                                 .channels = r->channels,
                                 .factor_channels = r->channels,
                                 .window = r->window,
                                 .terms = p->terms,
                                 .clusters = p->clusters,
                                 .mixed = 1,
                                 .layout = NACRE_KERNEL_SINGLE,
                                 .pixel = NACRE_FLOAT,
                                 .pitch_mm = pitch_mm,
                                 .epsilon = o->epsilon,
                                 .seed = o->seed};
    return nacre_material_allocate(m, true, false, error);
}

/* A response in its own unit, as error_source wants it. */
static int read_responses(const void *data, int x, int y, float *response,
                          struct nacre_error *error)
{
    (void)error;
    responses_read(data, x, y, response);
    return NACRE_OK;
}

/* The error of a material that is as it will be in the file. */
static int measure(const struct responses *r, struct nacre_material *m, struct error_report *report,
                   struct nacre_error *error)
{
    const struct error_source from = {.data = r, .read = read_responses, .beyond = r->beyond};
    int status = error_measure(&from, m, NULL, report, error);
    if (status == NACRE_OK) {
        m->error_min = report->whole.minimum;
        m->error_mean = report->whole.mean;
        m->error_max = report->whole.maximum;
    }
    return status;
}

/* Choose how F and H are stored, round them so, and measure the error of what will be in the file. A cancelled run still
 * gets here, so progress is not asked again whether to stop. */
static int round_and_measure(const struct responses *r, enum factor_store store,
                             struct nacre_material *m, struct error_report *report,
                             struct nacre_error *error)
{
    const struct error_source from = {.data = r, .read = read_responses, .beyond = r->beyond};
    size_t count =
        (size_t)m->terms * (size_t)m->factor_channels * (size_t)m->width * (size_t)m->height;
    float *exact = NULL;
    struct error_report before = {0};
    int status = NACRE_OK;
    if (store == FACTOR_STORE_AUTO) {
        exact = malloc(2 * count * sizeof *exact);
        if (!exact) {
            return nacre_fail_memory(error, "the factors");
        }
        memcpy(exact, m->f, count * sizeof *exact);
        memcpy(exact + count, m->h, count * sizeof *exact);
        status = error_measure(&from, m, NULL, &before, error);
    }
    m->pixel = store == FACTOR_STORE_FLOAT ? NACRE_FLOAT : NACRE_HALF;
    nacre_material_round(m);
    if (status == NACRE_OK) {
        status = error_measure(&from, m, NULL, report, error);
    }
    if (status == NACRE_OK && exact && !(report->whole.mean <= 1.01 * before.whole.mean)) {
        struct error_report rounded = *report;
        m->pixel = NACRE_FLOAT;
        memcpy(m->f, exact, count * sizeof *exact);
        memcpy(m->h, exact + count, count * sizeof *exact);
        *report = before;
        before = rounded;
    }
    m->error_min = report->whole.minimum;
    m->error_mean = report->whole.mean;
    m->error_max = report->whole.maximum;
    error_report_finish(&before);
    free(exact);
    return status;
}

int closing_make(const struct factor_options *o, double pitch_mm, const struct attempt *attempt,
                 struct nacre_material *m, struct error_report *report, struct nacre_error *error)
{
    int status = allocate(o, pitch_mm, &attempt->problem, m, error);
    if (status == NACRE_OK && attempt->problem.data) {
        status = terms_material_fill(&attempt->problem, &attempt->factors, m, error);
        if (status == NACRE_OK) {
            status = measure(attempt->problem.responses, m, report, error);
        }
    } else if (status == NACRE_OK) {
        status = assemble_material(&attempt->problem, &attempt->factors, m, error);
    }
    if (status == NACRE_OK && !attempt->problem.data) {
        status = round_and_measure(attempt->problem.responses, o->store, m, report, error);
    }
    if (status != NACRE_OK) {
        nacre_material_finish(m);
    }
    return status;
}

/* A copy of the factors with planes as they will be in the file, to be finished whatever is returned. */
static int round_copy(const struct attempt *a, int bits, struct factors *copy,
                      struct nacre_error *error)
{
    int status = factors_allocate(copy, &a->problem, error);
    if (status == NACRE_OK) {
        factors_copy(copy, &a->factors);
        status = terms_material_round(&a->problem, bits, copy, error);
    }
    return status;
}

/* The error of a few points with them. */
static int measure_rounded(const struct probe *probe, const struct attempt *a, int bits,
                           double *rounded, struct nacre_error *error)
{
    struct factors copy;
    int status = round_copy(a, bits, &copy, error);
    if (status == NACRE_OK) {
        *rounded = probe_measure(probe, &a->problem, &copy);
    }
    factors_finish(&copy);
    return status;
}

int closing_choose_bits(const struct probe *probe, const struct attempt *attempt, int *bits,
                        struct closing_rounding *rounding, struct nacre_error *error)
{
    static const int choices[] = {FACTOR_BITS_LEAST, 10, 0};
    int status = NACRE_OK;
    *rounding = (struct closing_rounding){
        .fitted = probe_measure(probe, &attempt->problem, &attempt->factors)};
    for (size_t i = 0; i < sizeof choices / sizeof *choices && status == NACRE_OK; i++) {
        double rounded = 0;
        status = measure_rounded(probe, attempt, choices[i], &rounded, error);
        rounding->coarsest = i == 0 ? rounded : rounding->coarsest;
        rounding->rounded = rounded;
        *bits = choices[i];
        if (rounded <= MOST_ROUNDED * rounding->fitted ||
            rounded - rounding->fitted <= LEAST_ROUNDING) {
            break;
        }
    }
    return status;
}

int closing_rehearse(const struct factor_options *o, const struct attempt *attempt, double *share,
                     struct nacre_error *error)
{
    const struct error_source from = {.data = attempt->problem.responses,
                                      .read = read_responses,
                                      .beyond = attempt->problem.responses->beyond};
    struct nacre_material m;
    int rows = 0;
    int status = allocate(o, 1, &attempt->problem, &m, error);
    if (status == NACRE_OK) {
        rows = m.height / 16 > 8 ? m.height / 16 : m.height < 8 ? m.height : 8;
        status = error_rehearse(&from, &m, rows, error);
    }
    /* The albedo costs a fifth of one measurement. */
    *share = (double)rows / attempt->problem.responses->height /
             (o->store == FACTOR_STORE_AUTO ? 2.2 : 1.2);
    nacre_material_finish(&m);
    return status;
}

int closing_rehearse_rounding(const struct attempt *attempt, struct nacre_error *error)
{
    struct factors copy;
    int status =
        attempt->problem.data ? round_copy(attempt, FACTOR_BITS_LEAST, &copy, error) : NACRE_OK;
    if (attempt->problem.data) {
        factors_finish(&copy);
    }
    return status;
}

double closing_write_seconds(double bytes)
{
    return 0.35 + bytes / 40e6;
}
