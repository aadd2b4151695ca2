/* Labels beside dots of a plot that do not cover each other, nor labelled dots. */
#include "study/plot_labels.h"

/* Of digits in the page's font of 11 pixels; ASCENT is that of digits, too. */
#define CHARACTER 6.6
#define ASCENT    8.5

static bool is_free(const struct plot_labels *labels, const struct plot_box *box)
{
    if (box->left < labels->left || box->right > labels->right || box->top < labels->top ||
        box->bottom > labels->bottom) {
        return false;
    }
    for (size_t i = 0; i < labels->count; i++) {
        const struct plot_box *other = &labels->boxes[i];
        if (box->left < other->right && other->left < box->right && box->top < other->bottom &&
            other->top < box->bottom) {
            return false;
        }
    }
    return true;
}

static void take(struct plot_labels *labels, struct plot_box box)
{
    if (labels->count < PLOT_BOXES) {
        labels->boxes[labels->count++] = box;
    }
}

void plot_labels_avoid(struct plot_labels *labels, double x, double y, double radius)
{
    take(labels, (struct plot_box){x - radius, x + radius, y - radius, y + radius});
}

bool plot_labels_place(struct plot_labels *labels, double x, double y, double radius,
                       size_t characters, struct plot_label *label)
{
    /* Above to the right first: a front falls from the left to the right, which leaves room there. */
    static const struct {
        double across, down; /* of the text's middle, in directions from the dot */
    } directions[] = {{1, -1}, {1, 0}, {0, -1}, {-1, 1}, {0, 1}, {-1, 0}, {1, 1}, {-1, -1}};
    enum { DIRECTIONS = sizeof directions / sizeof *directions, DISTANCES = 4 };
    double width = CHARACTER * (double)characters;
    for (int i = 0; i < DISTANCES * DIRECTIONS; i++) {
        int ring = i / DIRECTIONS;
        double gap = radius + 0.5 + 11.0 * ring;
        double across = directions[i % DIRECTIONS].across, down = directions[i % DIRECTIONS].down;
        double middle_x = x + across * (gap + width / 2), middle_y = y + down * (gap + ASCENT / 2);
        struct plot_box box = {middle_x - width / 2, middle_x + width / 2, middle_y - ASCENT / 2,
                               middle_y + ASCENT / 2};
        if (is_free(labels, &box)) {
            take(labels, box);
            *label = (struct plot_label){box.left, box.bottom, width, i >= DIRECTIONS};
            return true;
        }
    }
    return false;
}
