/* Makes a thousand of the paper's updates on each case and prints the goals that cases.c keeps. */
#include "cases.h"
#include "timing.h"

#include "factor/layout.h"
#include "factor/update.h"

#include <stdio.h>
#include <stdlib.h>

static void print_goal(const struct bench_case *c, const struct opencl *opencl)
{
    struct nacre_error error = {0};
    struct case_problem made;
    struct method *method = NULL;
    double prefix = 0;
    case_make(c, layout_lanes(opencl), false, &made);
    if (update_new(opencl, &made.attempt.problem, NULL, &method, &error) != NACRE_OK) {
        fail(error.text);
    }
    struct moment start = timing_now();
    for (int i = 1; i <= CASE_UPDATES; i++) {
        for (int channel = 0; channel < c->channels; channel++) {
            if (method->ops->step(method, channel, NULL, &error) != NACRE_OK) {
                fail(error.text);
            }
        }
        /* Now and then, so that not all of them wait in the queue at once. */
        if (i % CASE_PREFIX == 0 && update_wait(method, &error) != NACRE_OK) {
            fail(error.text);
        }
        if (i == CASE_PREFIX) {
            prefix = case_objective(&made, method);
        }
    }
    double goal = case_objective(&made, method);
    printf("%-10s %3d x %3d, K %d, %d channels, T %d, k %3d: %.8g, %.8g (%.0f s)\n", c->name,
           c->width, c->height, c->window, c->channels, c->terms, c->clusters, prefix, goal,
           timing_since(start).wall);
    (void)fflush(stdout);
    method_free(method);
    case_finish(&made);
}

/* Arguments: numbers of the cases, from 0; none for all. */
int main(int argc, char **argv)
{
    struct nacre_error error = {0};
    struct opencl opencl;
    int count = 0;
    while (cases[count].name) {
        count++;
    }
    if (opencl_open(NULL, &opencl, &error) != NACRE_OK) {
        fail(error.text);
    }
    for (int i = 1; i < argc; i++) {
        int number = (int)strtol(argv[i], NULL, 10);
        if (number < 0 || number >= count) {
            fail("usage: bench_goals [NUMBER OF A CASE ...]");
        }
        print_goal(&cases[number], &opencl);
    }
    for (int i = 0; i < count && argc == 1; i++) {
        print_goal(&cases[i], &opencl);
    }
    opencl_close(&opencl);
    return EXIT_SUCCESS;
}
