/* A small station with every effect, and frames of it. */
#ifndef TESTS_VIRTUAL_FULL_H
#define TESTS_VIRTUAL_FULL_H

#include "rig/virtual/virtual.h"

enum {
    FULL_WIDTH = 80,
    FULL_HEIGHT = 60,
    FULL_PIXELS = FULL_WIDTH * FULL_HEIGHT,
    FULL_COLUMNS = 16,
    FULL_ROWS = 12,
};

/* Station and sample files; every effect but faults of single frames is large enough to be seen. */
extern const char full_station[], full_sample[];

/* What an effect needs of the two files: taking this piece out leaves a station without it. */
struct full_piece {
    enum effect_id effect;
    const char *text;
    bool of_sample;
    double least; /* what it changes of full_frame, mean absolute difference over the mean */
};
extern const struct full_piece full_pieces[];
extern const int full_piece_count;

/* `text` with `piece` taken out of it; heap. */
char *full_take_out(const char *text, const char *piece);

/* The station of these texts in the test's folder. */
struct virtual_station *full_make(const char *station_text, const char *sample_text);

/* Squares of 2 x 2 points on the sample for 1.5 turns of the wheel, as the first frame of the station: raw[FULL_PIXELS]. */
void full_frame(struct virtual_station *station, uint16_t *raw);

#endif
