/* What the user should know of a result that was made all the same. */
#ifndef RIG_DEVELOP_WARNINGS_H
#define RIG_DEVELOP_WARNINGS_H

/* Zero-initialised it is empty. What does not fit any more is left out. */
struct warnings {
    int count;
    char texts[8][640];
};

/* Add a sentence: what, by how much, and what to do about it. */
void warnings_add(struct warnings *warnings, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

#endif
