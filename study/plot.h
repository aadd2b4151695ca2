/* Line plots as inline SVG. */
#ifndef STUDY_PLOT_H
#define STUDY_PLOT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

struct plot_series {
    const double *x, *y; /* NaN, and what a logarithmic axis cannot show, leave a gap */
    size_t count;
    char colour[8];            /* "#rrggbb" */
    bool dots;                 /* instead of a line */
    double radius;             /* of dots; 0: 2 */
    const char *const *labels; /* [count]: plain text beside each dot that has room, or NULL */
};

struct plot {
    const char *title, *x_label, *y_label; /* plain text */
    bool x_log, y_log;
    double y_floor; /* nothing below this is shown; 0: no floor */
    double margin;  /* share of an axis that is left free at both ends */
    bool y_from_zero;
    int width, height; /* in units of a pixel of 1/96 inch */
    const struct plot_series *series;
    size_t series_count;
};

/* Write the plot. Axes reach as far as the data do, and the margin farther; without data the plot says so. */
void plot_write(FILE *page, const struct plot *plot);

/* Bars over equal ranges of x from 0 to x_maximum; the bar's height is its count. */
void plot_histogram(FILE *page, const struct plot *plot, const double *counts, size_t count,
                    double x_maximum, const char *colour);

#endif
