/* Orders of the Bayer colour filter mosaic. */
#ifndef RIG_BAYER_H
#define RIG_BAYER_H

/* Named by the colours of the first two pixels of the first two rows. */
enum bayer { BAYER_RGGB, BAYER_BGGR, BAYER_GRBG, BAYER_GBRG, BAYER_MONO };

/* Names in the order of the enum, NULL-terminated: "RGGB", ..., "mono". */
extern const char *const bayer_names[];

/* The colour channel (0 R, 1 G, 2 B; 0 for mono) of pixel (x, y). */
static inline int bayer_channel(enum bayer bayer, int x, int y)
{
    static const unsigned char channels[5][2][2] = {
        {{0, 1}, {1, 2}}, {{2, 1}, {1, 0}}, {{1, 0}, {2, 1}}, {{1, 2}, {0, 1}}, {{0, 0}, {0, 0}}};
    return channels[bayer][y & 1][x & 1];
}

#endif
