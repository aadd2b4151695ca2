/* How every function of nacre says what went wrong: a status to test and one sentence to print. */
#ifndef NACRE_ERROR_H
#define NACRE_ERROR_H

/* Functions that can fail return one of these; everything but NACRE_OK is negative. */
enum nacre_status {
    NACRE_OK = 0,
    NACRE_FAILED = -1,    /* the error's text says what, of which object, and the remedy */
    NACRE_CANCELLED = -2, /* the caller asked to stop; whole files were left */
};

/* Belongs to the caller and needs no clean-up. The text is one line without a final full stop or newline:
 * object, action, cause, and where there is one the remedy ("scan.exr: tile (3, 4): ..."). */
struct nacre_error {
    char text[1024];
};

/* Write the text (error may be NULL) and return NACRE_FAILED, so that failing is one statement. */
int nacre_fail(struct nacre_error *error, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* The same with ": " and the meaning of errno value `number` behind it. */
int nacre_fail_errno(struct nacre_error *error, int number, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* NACRE_FAILED with the text of memory having run out for `what`. */
int nacre_fail_memory(struct nacre_error *error, const char *what);

/* Put "PREFIX: " before the text that is there, as an error travels up to code that knows the object.
 * Returns NACRE_FAILED. */
int nacre_fail_within(struct nacre_error *error, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

#endif
