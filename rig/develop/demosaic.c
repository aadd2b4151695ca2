/* Full colour from a Bayer mosaic by linear filters (Malvar, He and Cutler, ICASSP 2004). */
#include "rig/develop/demosaic.h"

#include <stddef.h>

static int mirror(int i, int size)
{
    return i < 0 ? -i : i >= size ? 2 * (size - 1) - i : i;
}

/* The sums around a pixel of which all filters are made. */
struct neighbourhood {
    float centre;
    float near_x, near_y; /* both at distance 1 */
    float far_x, far_y;   /* both at distance 2 */
    float corners;        /* all four diagonal neighbours */
};

static struct neighbourhood look(const float *mosaic, int width, int height, int x, int y)
{
    const float *rows[5];
    int columns[5];
    for (int k = 0; k < 5; k++) {
        rows[k] = mosaic + (size_t)mirror(y + k - 2, height) * (size_t)width;
        columns[k] = mirror(x + k - 2, width);
    }
    return (struct neighbourhood){rows[2][columns[2]],
                                  rows[2][columns[1]] + rows[2][columns[3]],
                                  rows[1][columns[2]] + rows[3][columns[2]],
                                  rows[2][columns[0]] + rows[2][columns[4]],
                                  rows[0][columns[2]] + rows[4][columns[2]],
                                  rows[1][columns[1]] + rows[1][columns[3]] + rows[3][columns[1]] +
                                      rows[3][columns[3]]};
}

/* Green at red or blue: the mean of the four greens, and half the Laplacian of the colour that is there. */
static float green(const struct neighbourhood *n)
{
    return (2 * (n->near_x + n->near_y) + 4 * n->centre - n->far_x - n->far_y) / 8;
}

/* Red or blue at green, whose two neighbours of that colour lie along the axis called near: their mean, and 5/8 of a
 * Laplacian of green over nine points. */
static float beside(float near, float far, float far_across, const struct neighbourhood *n)
{
    return (4 * near + 5 * n->centre - n->corners - far + far_across / 2) / 8;
}

/* Red at blue or blue at red: the mean of the four corners, and 3/4 of the Laplacian of the colour that is there. */
static float opposite(const struct neighbourhood *n)
{
    return (2 * n->corners + 6 * n->centre - 1.5F * (n->far_x + n->far_y)) / 8;
}

void demosaic_malvar(const float *mosaic, int width, int height, enum bayer bayer, float *planes)
{
    size_t pixels = (size_t)width * (size_t)height;
    for (int y = 0; y < height; y++) {
        for (int x = 0; x < width; x++) {
            struct neighbourhood n = look(mosaic, width, height, x, y);
            float *red = planes + (size_t)y * (size_t)width + (size_t)x;
            int channel = bayer_channel(bayer, x, y);
            if (channel == 1) {
                int across = bayer_channel(bayer, x + 1, y); /* the colour left and right */
                red[pixels] = n.centre;
                red[pixels * (size_t)across] = beside(n.near_x, n.far_x, n.far_y, &n);
                red[pixels * (size_t)(2 - across)] = beside(n.near_y, n.far_y, n.far_x, &n);
            } else {
                red[pixels] = green(&n);
                red[pixels * (size_t)channel] = n.centre;
                red[pixels * (size_t)(2 - channel)] = opposite(&n);
            }
        }
    }
}
