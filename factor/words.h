/* How large a material is, in words. */
#ifndef FACTOR_WORDS_H
#define FACTOR_WORDS_H

/* "8 terms" with 0 clusters, as a kernel per term has; else "8 terms, 100 clusters". */
struct size_words {
    char text[40];
};
struct size_words size_words(int terms, int clusters);

/* The paper's compression ratio (Table 1), of bytes `before` and `after`: "1/69"; "2.2/1" where the material is the larger. */
struct ratio_words {
    char text[32];
};
struct ratio_words ratio_words(double before, double after);

#endif
