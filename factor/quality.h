/* What is wrong with the data rather than with the model: figures of a scan, and warnings in words. */
#ifndef FACTOR_QUALITY_H
#define FACTOR_QUALITY_H

#include "factor/responses.h"

#include "nacre/material.h"

/* Of the measured points. Shares are 0 to 1. Reciprocal pairs are R(x_i, x_o) and R(x_o, x_i), x_i not x_o: light that
 * goes the same way forth and back, so two measurements of one number. */
struct quality {
    double
        missing; /* share of entries inside the sample, of measured responses, that are missing */
    double
        saturated; /* share of entries at the channel's largest value, two or more side by side */
    double peak_x,
        peak_y; /* of the mean response, in points from the centre: its middle above half its peak */
    double rim;         /* share of the responses' sum that lies on the rim of the window */
    size_t pairs;       /* that were compared; 0: the two below are not known */
    double reciprocity; /* ||R - R^T|| / ||R|| over pairs, less what noise explains */
    double noise;       /* standard deviation of an entry over its value, as norms over pairs */
    double floor;       /* mean over points of the noise over ||R_i||, the centre included */
};

/* Looks at about four million entries at most, of rows of points spread over the sample. */
int quality_measure(const struct responses *responses, struct quality *quality,
                    struct nacre_error *error);

/* Append to the material's warnings what a person should know; `wanted`: the mean error asked for, 1: none. */
int quality_warn(const struct quality *quality, double wanted, struct nacre_material *material,
                 struct nacre_error *error);

/* Likewise where planes of so many bits make the mean error much larger than it is of those that were fitted. */
int quality_warn_planes(int bits, double fitted, double rounded, struct nacre_material *material,
                        struct nacre_error *error);

#endif
