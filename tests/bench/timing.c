/* What the benchmarks share. */
#include "timing.h"

#include "base/clock.h"

#include <cblas.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

struct moment timing_now(void)
{
    struct clock clock = clock_monotonic();
    struct timespec time;
    (void)clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return (struct moment){(double)clock_now_ns(&clock) * 1e-9,
                           (double)time.tv_sec + (double)time.tv_nsec * 1e-9};
}

struct moment timing_since(struct moment start)
{
    struct moment end = timing_now();
    return (struct moment){end.wall - start.wall, end.processor - start.processor};
}

void fail(const char *text)
{
    (void)fprintf(stderr, "%s\n", text);
    exit(EXIT_FAILURE);
}

void *allocate(size_t bytes)
{
    void *memory = calloc(1, bytes);
    if (!memory) {
        fail("no memory");
    }
    return memory;
}

static int compare_doubles(const void *a, const void *b)
{
    double difference = *(const double *)a - *(const double *)b;
    return difference < 0 ? -1 : difference > 0;
}

double timing_median(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, compare_doubles);
    return values[count / 2];
}

struct sgemm sgemm_new(void)
{
    size_t count = (size_t)SGEMM_SIZE * SGEMM_SIZE;
    struct sgemm sgemm = {allocate(count * sizeof(float)), allocate(count * sizeof(float)),
                          allocate(count * sizeof(float))};
    for (size_t i = 0; i < count; i++) {
        sgemm.a[i] = sgemm.b[i] = (float)(i % 7) * 0.1F;
    }
    return sgemm;
}

struct moment sgemm_run(const struct sgemm *sgemm)
{
    struct moment start = timing_now();
    cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, SGEMM_SIZE, SGEMM_SIZE, SGEMM_SIZE, 1,
                sgemm->a, SGEMM_SIZE, sgemm->b, SGEMM_SIZE, 0, sgemm->c, SGEMM_SIZE);
    return timing_since(start);
}

void sgemm_finish(struct sgemm *sgemm)
{
    free(sgemm->a);
    free(sgemm->b);
    free(sgemm->c);
}

double entries_inside(int width, int height, int window)
{
    double columns = 0, rows = 0;
    for (int d = -(window / 2); d <= window / 2; d++) {
        columns += fmax(0, width - abs(d));
        rows += fmax(0, height - abs(d));
    }
    return columns * rows;
}
