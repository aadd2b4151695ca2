/* Labels beside dots of a plot that do not cover each other, nor labelled dots. */
#ifndef STUDY_PLOT_LABELS_H
#define STUDY_PLOT_LABELS_H

#include <stdbool.h>
#include <stddef.h>

enum { PLOT_BOXES = 512 };

/* What is taken already, in pixels; a zeroed one but for the frame has nothing. */
struct plot_labels {
    double left, right, top, bottom; /* the frame that labels stay in */
    struct plot_box {
        double left, right, top, bottom;
    } boxes[PLOT_BOXES];
    size_t count;
};

/* Where a label's text begins, on its baseline; far: so far from its dot that a line should lead there. */
struct plot_label {
    double x, y, width;
    bool far;
};

/* Keep labels away from a dot; what is beyond PLOT_BOXES is not kept away from. */
void plot_labels_avoid(struct plot_labels *labels, double x, double y, double radius);

/* Find room beside a dot at (x, y) for a text of so many characters, and take it; false where there is none. */
bool plot_labels_place(struct plot_labels *labels, double x, double y, double radius,
                       size_t characters, struct plot_label *label);

#endif
