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
    const char *format = before > after ? "1/%.*f" : "%.*f/1";
    (void)snprintf(words.text, sizeof words.text, format, ratio < whole_ratio ? 1 : 0, ratio);
    return words;
}
