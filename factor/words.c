/* A material's size in words. */
#include "factor/words.h"

#include <stdio.h>

/* From here on a ratio has two digits without a point. */
static const double whole_ratio = 9.5;

struct size_words size_words(int terms, int clusters)
{
    struct size_words words;
    char more[24] = "";
    if (clusters > 0) {
        (void)snprintf(more, sizeof more, ", %d cluster%s", clusters, clusters == 1 ? "" : "s");
    }
    (void)snprintf(words.text, sizeof words.text, "%d term%s%s", terms, terms == 1 ? "" : "s",
                   more);
    return words;
}

struct ratio_words ratio_words(double before, double after)
{
    struct ratio_words words;
    double ratio = before > after ? before / after : after / before;
    int digits = ratio < whole_ratio ? 1 : 0;
    if (before > after) {
        (void)snprintf(words.text, sizeof words.text, "1/%.*f", digits, ratio);
    } else {
        (void)snprintf(words.text, sizeof words.text, "%.*f/1", digits, ratio);
    }
    return words;
}
