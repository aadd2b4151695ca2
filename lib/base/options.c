/* Choosing the verb, parsing its options by the tables, and turning its status into the program's.
 */
#include "base/options.h"

#include "base/nearest.h"
#include "base/options_table.h"
#include "base/progress.h"

#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { EXIT_WRONG_USAGE = 2, EXIT_STOPPED = 130, FIRST_LONG = 256 };

const struct option_spec options_common_table[] = {
    {.name = "help",
     .letter = 'h',
     .kind = OPTION_FLAG,
     .sentence = "print this text",
     .offset = offsetof(struct options_common, help)},
    {.name = "quiet",
     .letter = 'q',
     .kind = OPTION_FLAG,
     .sentence = "show no progress",
     .offset = offsetof(struct options_common, quiet)},
    {.name = "json",
     .kind = OPTION_FLAG,
     .sentence = "print results as JSON",
     .offset = offsetof(struct options_common, json)},
    {.name = "device",
     .kind = OPTION_STRING,
     .argument = "NAME",
     .sentence = "compute on this OpenCL device: its number or part of its name as `nacre devices` "
                 "prints them (otherwise NACRE_DEVICE, or the first GPU, or the first device)",
     .offset = offsetof(struct options_common, device)},
    {0}};

/* The tables of one verb and what getopt_long makes of them. */
struct parser {
    const struct option_spec **specs; /* own and common ones */
    void **targets;                   /* the struct that each one's offset is in */
    bool *given;
    size_t count;
    struct option *longs; /* a zeroed one behind the last; val is FIRST_LONG + index */
    char *letters;
};

static size_t count_options(const struct option_spec *table)
{
    size_t count = 0;
    while (table && table[count].name) {
        count++;
    }
    return count;
}

static void parser_finish(struct parser *parser)
{
    free(parser->specs);
    free(parser->targets);
    free(parser->given);
    free(parser->longs);
    free(parser->letters);
    *parser = (struct parser){0};
}

static void parser_add(struct parser *parser, const struct option_spec *table, void *target)
{
    for (; table && table->name; table++) {
        bool takes_argument = table->kind != OPTION_FLAG;
        size_t i = parser->count++;
        parser->specs[i] = table;
        parser->targets[i] = target;
        parser->longs[i] =
            (struct option){.name = table->name,
                            .has_arg = takes_argument ? required_argument : no_argument,
                            .val = FIRST_LONG + (int)i};
        if (table->letter) {
            char *end =
                parser->letters + strlen(parser->letters); /* two bytes an option are there */
            end[0] = table->letter;
            end[1] = takes_argument ? ':' : '\0';
        }
    }
}

static int parser_init(struct parser *parser, const struct verb *verb, void *settings,
                       struct options_common *common, struct nacre_error *error)
{
    size_t count = count_options(verb->options) + count_options(options_common_table) + 1;
    *parser = (struct parser){.specs = calloc(count, sizeof(struct option_spec *)),
                              .targets = calloc(count, sizeof(void *)),
                              .given = calloc(count, sizeof(bool)),
                              .longs = calloc(count, sizeof(struct option)),
                              .letters = calloc(count, 2)};
    if (!parser->specs || !parser->targets || !parser->given || !parser->longs ||
        !parser->letters) {
        parser_finish(parser);
        (void)nacre_fail_memory(error, "the table of options");
        return NACRE_FAILED;
    }
    parser->letters[0] = ':'; /* a missing argument is told apart */
    parser_add(parser, verb->options, settings);
    parser_add(parser, options_common_table, common);
    return NACRE_OK;
}

/* The option that getopt's value means, or NULL. */
static const struct option_spec *find_option(const struct parser *parser, int value, size_t *index)
{
    for (size_t i = 0; i < parser->count; i++) {
        if (value == FIRST_LONG + (int)i || (value && value == parser->specs[i]->letter)) {
            *index = i;
            return parser->specs[i];
        }
    }
    return NULL;
}

/* A long option that getopt did not take: unknown, short for several, or given an argument it does not have. */
static int refuse_long(const struct parser *parser, const char *typed, struct nacre_error *error)
{
    char name[64];
    size_t length = strcspn(typed + 2, "=");
    const char *first = NULL;
    (void)snprintf(name, sizeof name, "%.*s", (int)length, typed + 2);
    struct nearest nearest = nearest_begin(name);
    for (size_t i = 0; i < parser->count; i++) {
        const char *known = parser->specs[i]->name;
        if (strncmp(known, name, length) == 0 && first) {
            return nacre_fail(error, "--%s: could be --%s or --%s; type more of it", name, first,
                              known);
        }
        first = strncmp(known, name, length) == 0 ? known : first;
        nearest_offer(&nearest, known);
    }
    if (nearest.best) {
        return nacre_fail(error, "unknown option --%s; did you mean --%s?", name, nearest.best);
    }
    return nacre_fail(error, "unknown option --%s", name);
}

static int refuse_option(const struct parser *parser, int result, char **argv,
                         struct nacre_error *error)
{
    size_t index = 0;
    const struct option_spec *spec = find_option(parser, optopt, &index);
    if (result == ':' && spec) {
        return nacre_fail(error, "--%s: needs an argument: %s", spec->name,
                          spec->argument ? spec->argument : "a word");
    }
    if (spec && optopt >= FIRST_LONG) {
        return nacre_fail(error, "--%s: takes no argument", spec->name);
    }
    if (optopt == 0) {
        return refuse_long(parser, argv[optind - 1], error);
    }
    return nacre_fail(error, "unknown option -%c", optopt);
}

static int parse_options(struct parser *parser, int argc, char **argv, struct nacre_error *error)
{
    int result = 0;
    optind = 0; /* makes glibc begin anew */
    opterr = 0;
    while ((result = getopt_long(argc, argv, parser->letters, parser->longs, NULL)) != -1) {
        size_t index = 0;
        const struct option_spec *spec = find_option(parser, result, &index);
        if (result == '?' || result == ':' || !spec) {
            return refuse_option(parser, result, argv, error);
        }
        int set = options_set_value(spec, optarg, parser->targets[index], error);
        if (set != NACRE_OK) {
            return set;
        }
        parser->given[index] = true;
    }
    return NACRE_OK;
}

static int apply_defaults(const struct verb *verb, void *settings, struct nacre_error *error)
{
    for (const struct option_spec *spec = verb->options; spec && spec->name; spec++) {
        if (spec->fallback &&
            options_set_value(spec, spec->fallback, settings, error) != NACRE_OK) {
            return nacre_fail_within(error, "the default of an option of %s", verb->name);
        }
    }
    return NACRE_OK;
}

static int check_completeness(const struct verb *verb, const struct parser *parser, int operands,
                              char **argv, struct nacre_error *error)
{
    if (operands < verb->operand_minimum) {
        return nacre_fail(error, "an argument is missing: %s takes %s", verb->name, verb->operands);
    }
    if (operands > verb->operand_maximum) {
        return nacre_fail(error, "'%s' is one argument too many: %s takes %s",
                          argv[optind + verb->operand_maximum], verb->name,
                          verb->operands && *verb->operands ? verb->operands : "none");
    }
    for (size_t i = 0; i < parser->count; i++) {
        const struct option_spec *spec = parser->specs[i];
        if (spec->required && !parser->given[i]) {
            return nacre_fail(error, "--%s %s is missing: %s", spec->name,
                              spec->argument ? spec->argument : "WORD", spec->sentence);
        }
    }
    return NACRE_OK;
}

int options_parse(const struct verb *verb, int argc, char **argv, void *settings,
                  struct invocation *invocation, bool *wants_help, struct nacre_error *error)
{
    struct options_common common = {0};
    struct parser parser;
    *wants_help = false;
    *invocation = (struct invocation){0};
    if (parser_init(&parser, verb, settings, &common, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    int result = apply_defaults(verb, settings, error);
    if (result == NACRE_OK) {
        result = parse_options(&parser, argc, argv, error);
    }
    if (result == NACRE_OK && !common.help) {
        result = check_completeness(verb, &parser, argc - optind, argv, error);
    }
    *wants_help = common.help;
    *invocation = (struct invocation){.quiet = common.quiet,
                                      .json = common.json,
                                      .device = common.device,
                                      .operands = argv + optind,
                                      .operand_count = argc - optind};
    if (result == NACRE_OK && !common.help) {
        result = options_check_outputs(verb, settings, invocation, error);
    }
    parser_finish(&parser);
    return result;
}

static void print_error(const struct program *program, const struct verb *verb,
                        const struct nacre_error *error)
{
    (void)fprintf(stderr, "%s%s%s: %s\n", program->name, verb ? " " : "", verb ? verb->name : "",
                  error->text);
}

static int wrong_usage(const struct program *program, const struct verb *verb,
                       const struct nacre_error *error)
{
    print_error(program, verb, error);
    (void)fprintf(stderr, "Try `%s%s%s --help`.\n", program->name, verb ? " " : "",
                  verb ? verb->name : "");
    return EXIT_WRONG_USAGE;
}

/* Results that did not reach standard output are a failure: the disk may be full. */
static int finish_output(const struct program *program, const struct verb *verb, int status)
{
    errno = 0;
    if ((fflush(stdout) != 0 || ferror(stdout)) && status == EXIT_SUCCESS) {
        struct nacre_error error;
        (void)nacre_fail_errno(&error, errno ? errno : EIO, "cannot write to standard output");
        print_error(program, verb, &error);
        return EXIT_FAILURE;
    }
    return status;
}

static int run_verb(const struct program *program, const struct verb *verb, int argc, char **argv)
{
    struct nacre_error error = {""};
    struct invocation invocation;
    bool wants_help = false;
    int status = EXIT_SUCCESS;
    void *settings = calloc(1, verb->settings_size ? verb->settings_size : 1);
    if (!settings) {
        (void)nacre_fail_memory(&error, "the options");
        print_error(program, verb, &error);
        return EXIT_FAILURE;
    }
    int parsed = options_parse(verb, argc, argv, settings, &invocation, &wants_help, &error);
    if (parsed == OPTIONS_OUT_OF_RANGE) {
        print_error(program, verb, &error);
        status = EXIT_FAILURE;
    } else if (parsed != NACRE_OK) {
        status = wrong_usage(program, verb, &error);
    } else if (wants_help) {
        options_print_help(program, verb, stdout);
    } else {
        progress_catch_signals();
        int result = verb->run(settings, &invocation, &error);
        if (result == OPTIONS_WRONG_USAGE) {
            status = wrong_usage(program, verb, &error);
        } else if (result != NACRE_OK) {
            (void)fflush(
                stdout); /* what there is comes before the error; finish_output checks it */
            print_error(program, verb, &error);
            status = result == NACRE_CANCELLED ? EXIT_STOPPED : EXIT_FAILURE;
        }
    }
    free(settings);
    return finish_output(program, verb, status);
}

static const struct verb *find_verb(const struct program *program, const char *name,
                                    struct nacre_error *error)
{
    struct nearest nearest = nearest_begin(name);
    for (const struct verb *const *verb = program->verbs; *verb; verb++) {
        if (strcmp((*verb)->name, name) == 0) {
            return *verb;
        }
        nearest_offer(&nearest, (*verb)->name);
    }
    nearest_offer(&nearest, "help");
    if (nearest.best) {
        (void)nacre_fail(error, "unknown verb '%s'; did you mean '%s'?", name, nearest.best);
    } else {
        (void)nacre_fail(error, "unknown verb '%s'", name);
    }
    return NULL;
}

/* `help`, `help VERB`, `help --man`, `help --man VERB`; argv[0] is "help". */
static int run_help(const struct program *program, int argc, char **argv)
{
    struct nacre_error error = {""};
    bool man = argc > 1 && strcmp(argv[1], "--man") == 0;
    const char *name = argv[man ? 2 : 1]; /* argv ends with NULL */
    const struct verb *verb = name ? find_verb(program, name, &error) : NULL;
    if (name && !verb) {
        return wrong_usage(program, NULL, &error);
    }
    if (man) {
        options_print_man(program, verb, stdout);
    } else {
        options_print_help(program, verb, stdout);
    }
    return finish_output(program, NULL, EXIT_SUCCESS);
}

/* A standard stream that the caller closed would give its number to the next file opened, and messages would be written
 * into that. Opened the wrong way round, using it fails instead. */
static void hold_standard_streams(void)
{
    for (int number = 0; number <= 2; number++) {
        if (fcntl(number, F_GETFD) == -1 && errno == EBADF) {
            (void)open("/dev/null",
                       number == 0 ? O_WRONLY : O_RDONLY); /* takes the lowest number */
        }
    }
}

int options_run(const struct program *program, int argc, char **argv)
{
    struct nacre_error error = {""};
    hold_standard_streams();
    if (argc < 2) {
        (void)nacre_fail(&error, "which verb?");
        return wrong_usage(program, NULL, &error);
    }
    if (strcmp(argv[1], "help") == 0) {
        return run_help(program, argc - 1, argv + 1);
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
        options_print_help(program, NULL, stdout);
        return finish_output(program, NULL, EXIT_SUCCESS);
    }
    if (strcmp(argv[1], "--version") == 0) {
        (void)printf("%s %s\n", program->name, program->version);
        return finish_output(program, NULL, EXIT_SUCCESS);
    }
    if (argv[1][0] == '-') {
        (void)nacre_fail(&error, "unknown option %s; a verb's options come behind the verb",
                         argv[1]);
        return wrong_usage(program, NULL, &error);
    }
    const struct verb *verb = find_verb(program, argv[1], &error);
    return verb ? run_verb(program, verb, argc - 1, argv + 1) : wrong_usage(program, NULL, &error);
}
