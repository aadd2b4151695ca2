/* A square lattice in a cloud of dots: which dot is which, and the map from places in the lattice to those of the dots. */
#ifndef RIG_DEVELOP_LATTICE_H
#define RIG_DEVELOP_LATTICE_H

#include "nacre/error.h"
#include "rig/develop/homography.h"

#include <stddef.h>

struct lattice {
    struct homography
        map;       /* (column, row) of a dot to where it was seen; any turn, column 0 anywhere */
    size_t dots;   /* that fit */
    double rms;    /* distance between dots and where the map puts them */
    double spread; /* root of the sum of their squared distances from their middle */
};

/* Find the lattice, whatever its turn, its place and the perspective. Dots that do not fit are left out. Fails below 9. */
int lattice_find(const struct point *dots, size_t count, struct lattice *lattice,
                 struct nacre_error *error);

#endif
