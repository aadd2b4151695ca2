/* What a plan of effects tells of one of them, for people. */
#ifndef BASE_EFFECT_H
#define BASE_EFFECT_H

#include <stdbool.h>

struct effect {
    char name[48];
    bool simulated;
    int line;       /* of the file that calls for it or forbids it; 0: none does */
    bool in_sample; /* of a virtual station: the file is the sample's, not the station's */
    double seconds; /* estimated cost on one core; 0: nothing beyond the other effects' */
    char reason[160];
};

#endif
