/* Materials with made-up but valid planes, for tests. */
#ifndef TESTS_NACRE_MADE_MATERIAL_H
#define TESTS_NACRE_MADE_MATERIAL_H

#include "nacre/material.h"

/* What a made material is to be like. */
struct made_material {
    enum nacre_layout layout;
    enum nacre_pixel pixel;
    int channels, factor_channels, mixed;
    bool with_h, with_centre;
};

/* 11 x 9 surface points, window 5, 3 terms, 4 clusters, pseudo-random values in (0, 1]; the test finishes it. */
struct nacre_material made_material(struct made_material wanted);

#endif
