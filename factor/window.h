/* The middle of a response, for a material whose window is smaller than its scan's. */
#ifndef FACTOR_WINDOW_H
#define FACTOR_WINDOW_H

/* Windows of a sample's points and what is to be left of them. */
struct window_cut {
    int width, height, channels; /* of the sample */
    int from, to;                /* K before and after, odd, to <= from */
};

/* Take the middle out of response[channels][from][from] of (x, y): middle[channels][to][to], which may be the same array.
 * Returns the sum of squares of what was measured inside the sample and is left out. */
double window_cut(const struct window_cut *cut, int x, int y, const float *response, float *middle);

#endif
