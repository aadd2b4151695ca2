/* A program's verbs and options as tables, from which parsing, --help and the man pages are made.
 */
#ifndef BASE_OPTIONS_H
#define BASE_OPTIONS_H

#include "nacre/error.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

enum option_kind {
    OPTION_FLAG,    /* bool, no argument */
    OPTION_INT,     /* int */
    OPTION_REAL,    /* double; "2 %" and "2%" are 0.02 */
    OPTION_SECONDS, /* double, seconds; suffixes ms s min h */
    OPTION_BYTES,   /* double, bytes; suffixes K M G, of 1024 */
    OPTION_STRING,  /* const char *, pointing into argv */
    OPTION_CHOICE,  /* int, the index of the word in `words` */
};

/* One option. A table ends with a zeroed entry. */
struct option_spec {
    const char *name; /* long name without the dashes */
    char letter;      /* short name, or 0 */
    enum option_kind kind;
    const char *argument;     /* what --help calls its argument ("N", "FILE"); NULL for choices */
    const char *const *words; /* OPTION_CHOICE: NULL-terminated */
    const char *unit;         /* of its number ("mm"), for messages and --help; NULL: none */
    double minimum,
        maximum;          /* inclusive; both 0: no limits; INFINITY or INT_MAX: none on that side */
    bool required;        /* wrong usage without it */
    bool writes;          /* OPTION_STRING: a file to write, which may not be one that is read */
    const char *fallback; /* the default as it would be typed; NULL: zero */
    const char *sentence; /* one sentence for --help, without a full stop */
    size_t offset;        /* of the value in the verb's settings */
};

/* What every verb is given beside its own settings; the options behind it are added to every verb's own. */
struct invocation {
    bool quiet;         /* --quiet: no progress */
    bool json;          /* --json: results on standard output as JSON */
    const char *device; /* --device, or NULL */
    char **operands;    /* arguments that are no options */
    int operand_count;
};

struct verb {
    const char *name;
    const char *operands; /* as shown in the usage line: "SCAN -o MATERIAL" */
    const char *summary;  /* one line, as an order: "factor a scan into a material" */
    const char *text;     /* a paragraph or two for the manual */
    int operand_minimum, operand_maximum;
    const struct option_spec *options;
    size_t settings_size;
    /* Do it. Returns a nacre_status, or OPTIONS_WRONG_USAGE where the options do not go together or one that is needed
     * is missing; the error is printed by the caller. */
    int (*run)(const void *settings, const struct invocation *invocation,
               struct nacre_error *error);
};

struct program {
    const char *name, *version, *summary;
    const struct verb *const *verbs; /* NULL-terminated */
};

/* Run the program: choose the verb, parse, call it. Returns the exit status: 0 done, 1 failed, 2 wrong usage, 130
 * stopped by the user. An error is printed as one message on standard error. Beside the verbs it knows --help,
 * --version, `help [VERB]` and, for the build, `help --man [VERB]`. */
int options_run(const struct program *program, int argc, char **argv);

/* A well-formed number that is not allowed: bad input (exit 1) rather than wrong usage (exit 2). */
enum { OPTIONS_OUT_OF_RANGE = -3 };

/* A verb's own finding of wrong usage (exit 2). */
enum { OPTIONS_WRONG_USAGE = -4 };

/* Parse one verb's arguments (argv[0] is ignored). `settings` is zeroed memory of settings_size and gets the defaults
 * first. A wrong option or value fails with a text that names it and says what would be right. `*wants_help` is set by
 * --help. argv is reordered.
 * Returns a nacre_status, or OPTIONS_OUT_OF_RANGE. */
int options_parse(const struct verb *verb, int argc, char **argv, void *settings,
                  struct invocation *invocation, bool *wants_help, struct nacre_error *error);

/* The text of `VERB --help`, and the man page of the verb (NULL: of the program) in roff. */
void options_print_help(const struct program *program, const struct verb *verb, FILE *file);
void options_print_man(const struct program *program, const struct verb *verb, FILE *file);

#endif
