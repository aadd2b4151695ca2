/* Tests of verbs and options: values, refusals, exit statuses, help and man pages. */
#include "base/options.h"
#include "base/options_table.h"
#include "base/progress.h"
#include "tests/files.h"
#include "unity.h"

#include <fcntl.h>
#include <limits.h>
#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

void setUp(void)
{
}

void tearDown(void)
{
}

struct values {
    int terms;
    int depth;
    double part;
    double within;
    double memory;
    double pitch;
    const char *output;
    int method;
    bool explain;
};

static const char *const methods[] = {"hals", "mu", "newton", NULL};

static const struct option_spec table[] = {{.name = "output",
                                            .letter = 'o',
                                            .kind = OPTION_STRING,
                                            .argument = "FILE",
                                            .required = true,
                                            .writes = true,
                                            .sentence = "the file to write",
                                            .offset = offsetof(struct values, output)},
                                           {.name = "terms",
                                            .letter = 't',
                                            .kind = OPTION_INT,
                                            .argument = "N",
                                            .minimum = 1,
                                            .maximum = 512,
                                            .fallback = "10",
                                            .sentence = "number of terms",
                                            .offset = offsetof(struct values, terms)},
                                           {.name = "depth",
                                            .kind = OPTION_INT,
                                            .argument = "N",
                                            .sentence = "an unlimited whole number",
                                            .offset = offsetof(struct values, depth)},
                                           {.name = "part",
                                            .kind = OPTION_REAL,
                                            .argument = "P",
                                            .minimum = -1,
                                            .maximum = 1,
                                            .sentence = "a part",
                                            .offset = offsetof(struct values, part)},
                                           {.name = "pitch",
                                            .kind = OPTION_REAL,
                                            .argument = "MM",
                                            .unit = "mm",
                                            .minimum = 0.01,
                                            .maximum = INFINITY,
                                            .fallback = "0.5",
                                            .sentence = "distance of surface points",
                                            .offset = offsetof(struct values, pitch)},
                                           {.name = "within",
                                            .kind = OPTION_SECONDS,
                                            .argument = "TIME",
                                            .sentence = "time to take",
                                            .offset = offsetof(struct values, within)},
                                           {.name = "memory",
                                            .kind = OPTION_BYTES,
                                            .argument = "SIZE",
                                            .minimum = 1 << 20,
                                            .maximum = INFINITY,
                                            .fallback = "1G",
                                            .sentence = "memory to use",
                                            .offset = offsetof(struct values, memory)},
                                           {.name = "method",
                                            .kind = OPTION_CHOICE,
                                            .words = methods,
                                            .fallback = "mu",
                                            .sentence = "the kind of update",
                                            .offset = offsetof(struct values, method)},
                                           {.name = "explain",
                                            .kind = OPTION_FLAG,
                                            .sentence = "say why",
                                            .offset = offsetof(struct values, explain)},
                                           {0}};

/* What the verb does is told by its first operand. */
static int run(const void *settings, const struct invocation *invocation, struct nacre_error *error)
{
    const struct values *values = settings;
    const char *task = invocation->operands[0];
    (void)printf("terms %d, to %s\n", values->terms, values->output);
    if (strcmp(task, "fail") == 0) {
        return nacre_fail(error, "scan.exr: broken");
    }
    if (strcmp(task, "interrupt") == 0) {
        (void)raise(SIGINT);
        return progress_step(NULL, 0, 1, NULL, error);
    }
    if (strcmp(task, "ignore") == 0) {
        (void)raise(SIGINT);
        (void)raise(SIGINT);
    }
    if (strcmp(task, "open") == 0) {
        int file = open(values->output, O_CREAT | O_WRONLY | O_CLOEXEC, 0600);
        (void)fflush(stdout); /* must not land in the file */
        (void)close(file);
    }
    return NACRE_OK;
}

static const struct verb factor = {
    .name = "factor",
    .operands = "SCAN -o MATERIAL",
    .summary = "factor a scan by a method whose name is too long for one line of a terminal",
    .text = "It's the first paragraph, whose words are so many that they take up more than a single"
            " line of eighty columns.\n\n.The second \\ has 'roff' characters-and-dashes.",
    .operand_minimum = 1,
    .operand_maximum = 2,
    .options = table,
    .settings_size = sizeof(struct values),
    .run = run,
};

static const struct verb devices = {
    .name = "devices", .operands = "", .summary = "list devices", .run = run};

static const struct verb *const verbs[] = {&factor, &devices, NULL};
static const struct program program = {
    .name = "nacre", .version = "1.2.3", .summary = "measures materials", .verbs = verbs};

/* A command line that may be written to, as main's may. */
struct line {
    char words[16][80];
    char *argv[17];
};

static int fill_argv(struct line *line, const char *name, const char *const *words)
{
    int argc = 0;
    for (const char *word = name; word; word = words[argc++]) {
        (void)snprintf(line->words[argc], sizeof line->words[argc], "%s", word);
        line->argv[argc] = line->words[argc];
    }
    line->argv[argc] = NULL;
    return argc;
}

/* One call of options_parse on "factor" and the words, NULL at the end. */
struct call {
    int result;
    struct values values;
    struct invocation invocation;
    bool wants_help;
    struct nacre_error error;
    struct line line;
};

static void parse(struct call *call, const char *const *words)
{
    memset(call, 0, sizeof *call);
    int argc = fill_argv(&call->line, "factor", words);
    call->result = options_parse(&factor, argc, call->line.argv, &call->values, &call->invocation,
                                 &call->wants_help, &call->error);
}

#define PARSE(call, ...) parse(call, (const char *const[]){__VA_ARGS__, NULL})

/* Parsing a complete line with one more option fails with exactly this text. */
static void expect_refusal(const char *option, const char *value, const char *text)
{
    struct call call;
    PARSE(&call, "scan.exr", "-o", "x", option, value);
    int expected = strstr(text, "out of range") ? OPTIONS_OUT_OF_RANGE : NACRE_FAILED;
    TEST_ASSERT_EQUAL_INT_MESSAGE(expected, call.result, option);
    TEST_ASSERT_EQUAL_STRING(text, call.error.text);
}

static void parse_fills_in_the_defaults_of_the_table(void)
{
    struct call call;
    PARSE(&call, "scan.exr", "-o", "material.exr");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, call.result, call.error.text);
    TEST_ASSERT_EQUAL_INT(10, call.values.terms);
    TEST_ASSERT_EQUAL_INT(0, call.values.depth);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, call.values.pitch);
    TEST_ASSERT_EQUAL_DOUBLE(1073741824, call.values.memory);
    TEST_ASSERT_EQUAL_INT(1, call.values.method);
    TEST_ASSERT_FALSE(call.values.explain);
    TEST_ASSERT_FALSE(call.invocation.quiet || call.invocation.json || call.wants_help);
    TEST_ASSERT_NULL(call.invocation.device);
}

static void parse_reads_every_kind_of_value(void)
{
    struct call call;
    PARSE(&call, "--terms=512", "scan.exr", "--output", "m", "--depth", "-7", "--part", "-0.25",
          "--method", "newton", "--explain", "-q", "--json", "--device=cpu");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, call.result, call.error.text);
    TEST_ASSERT_EQUAL_INT(512, call.values.terms);
    TEST_ASSERT_EQUAL_STRING("m", call.values.output);
    TEST_ASSERT_EQUAL_INT(-7, call.values.depth);
    TEST_ASSERT_EQUAL_DOUBLE(-0.25, call.values.part);
    TEST_ASSERT_EQUAL_INT(2, call.values.method);
    TEST_ASSERT_TRUE(call.values.explain && call.invocation.quiet && call.invocation.json);
    TEST_ASSERT_EQUAL_STRING("cpu", call.invocation.device);
    TEST_ASSERT_EQUAL_INT(1, call.invocation.operand_count);
    TEST_ASSERT_EQUAL_STRING("scan.exr", call.invocation.operands[0]);
}

static void numbers_take_the_suffixes_of_their_kind(void)
{
    static const struct {
        const char *option, *text;
        double value;
        size_t offset;
    } cases[] = {
        {"--part", "2%", 0.02, offsetof(struct values, part)},
        {"--part", "2 %", 0.02, offsetof(struct values, part)},
        {"--part", "7%", 0.07, offsetof(struct values, part)},
        {"--part", "1e-3", 0.001, offsetof(struct values, part)},
        {"--part", ".5", 0.5, offsetof(struct values, part)},
        {"--within", "90", 90, offsetof(struct values, within)},
        {"--within", "90s", 90, offsetof(struct values, within)},
        {"--within", "250ms", 0.25, offsetof(struct values, within)},
        {"--within", "1.5 min", 90, offsetof(struct values, within)},
        {"--within", "2h", 7200, offsetof(struct values, within)},
        {"--memory", "1048576", 1048576, offsetof(struct values, memory)},
        {"--memory", "2048K", 2097152, offsetof(struct values, memory)},
        {"--memory", "1.5 M", 1572864, offsetof(struct values, memory)},
        {"--memory", "3G", 3221225472.0, offsetof(struct values, memory)},
        {"--memory", "3GiB", 3221225472.0, offsetof(struct values, memory)},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct call call;
        PARSE(&call, "scan.exr", "-o", "x", cases[i].option, cases[i].text);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, call.result, call.error.text);
        /* Exactly: people compare 2 % with 0.02. */
        double value = *(double *)(void *)((char *)&call.values + cases[i].offset);
        TEST_ASSERT_TRUE_MESSAGE(value == cases[i].value, cases[i].text);
    }
}

static void numbers_outside_their_range_are_refused_with_range_and_unit(void)
{
    expect_refusal("--terms", "0", "--terms: 0 is out of range: 1 to 512");
    expect_refusal("--terms", "513", "--terms: 513 is out of range: 1 to 512");
    expect_refusal("--terms", "99999999999", "--terms: 99999999999 is out of range: 1 to 512");
    expect_refusal("--depth", "99999999999",
                   "--depth: 99999999999 is out of range: -2147483648 to 2147483647");
    expect_refusal("--part", "101%", "--part: 101% is out of range: -1 to 1");
    expect_refusal("--part", "1e999", "--part: 1e999 is out of range: -1 to 1");
    expect_refusal("--pitch", "0", "--pitch: 0 is out of range: at least 0.01 mm");
    expect_refusal("--pitch", "1e999", "--pitch: 1e999 is out of range: at least 0.01 mm");
    expect_refusal("--within", "-1", "--within: -1 is out of range: at least 0");
    expect_refusal("--memory", "4K", "--memory: 4K is out of range: at least 1M bytes");
}

static void texts_that_are_no_numbers_are_refused(void)
{
    static const char *const bad[] = {"",    " ",   "ten", "1x", "0x10", "1e",   "nan", "inf",
                                      "1 2", "--5", "1,5", " 1", "1 ",   "5 % ", "+",   "."};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct call call;
        PARSE(&call, "scan.exr", "-o", "x", "--part", bad[i]);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_FAILED, call.result, bad[i]);
        PARSE(&call, "scan.exr", "-o", "x", "--terms", bad[i]);
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_FAILED, call.result, bad[i]);
    }
    expect_refusal("--terms", "1.5", "--terms: '1.5' is not a whole number");
    expect_refusal("--terms", "5%", "--terms: '5%' is not a whole number");
    expect_refusal("--part", "5 s", "--part: '5 s' is not a number");
    expect_refusal(
        "--within", "5 m",
        "--within: '5 m' is not a time: a number, then ms, s, min, h or nothing for seconds");
    expect_refusal(
        "--memory", "5 X",
        "--memory: '5 X' is not a size: a number, then K, M, G (of 1024) or nothing for bytes");
}

static void unknown_words_and_options_suggest_the_nearest(void)
{
    expect_refusal("--method", "hasl",
                   "--method: 'hasl' is not hals, mu or newton; did you mean 'hals'?");
    expect_refusal("--method", "quick", "--method: 'quick' is not hals, mu or newton");
    expect_refusal("--tersm", "3", "unknown option --tersm; did you mean --terms?");
    expect_refusal("--tersm=3", "3", "unknown option --tersm; did you mean --terms?");
    expect_refusal("--devcie", "3", "unknown option --devcie; did you mean --device?");
    expect_refusal("--wavelength", "3", "unknown option --wavelength");
    expect_refusal("-z", "3", "unknown option -z");
}

static void an_unambiguous_beginning_of_an_option_is_enough(void)
{
    struct call call;
    PARSE(&call, "scan.exr", "-o", "x", "--ter", "4");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, call.result, call.error.text);
    TEST_ASSERT_EQUAL_INT(4, call.values.terms);
    expect_refusal("--me", "4", "--me: could be --memory or --method; type more of it");
}

static void arguments_that_are_missing_or_too_many_are_refused(void)
{
    struct call call;
    PARSE(&call, "scan.exr", "-o", "x", "--terms");
    TEST_ASSERT_EQUAL_STRING("--terms: needs an argument: N", call.error.text);
    PARSE(&call, "scan.exr", "-o");
    TEST_ASSERT_EQUAL_STRING("--output: needs an argument: FILE", call.error.text);
    PARSE(&call, "scan.exr", "-o", "x", "--method");
    TEST_ASSERT_EQUAL_STRING("--method: needs an argument: a word", call.error.text);
    PARSE(&call, "scan.exr", "-o", "x", "--explain=yes");
    TEST_ASSERT_EQUAL_STRING("--explain: takes no argument", call.error.text);
    PARSE(&call, "scan.exr");
    TEST_ASSERT_EQUAL_STRING("--output FILE is missing: the file to write", call.error.text);
    PARSE(&call, "-o", "x");
    TEST_ASSERT_EQUAL_STRING("an argument is missing: factor takes SCAN -o MATERIAL",
                             call.error.text);
    PARSE(&call, "a", "b", "-o", "x", "c");
    TEST_ASSERT_EQUAL_STRING("'c' is one argument too many: factor takes SCAN -o MATERIAL",
                             call.error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, call.result);
}

static void two_dashes_end_the_options(void)
{
    struct call call;
    PARSE(&call, "-o", "x", "--", "--terms", "-q");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, call.result, call.error.text);
    TEST_ASSERT_EQUAL_INT(2, call.invocation.operand_count);
    TEST_ASSERT_EQUAL_STRING("--terms", call.invocation.operands[0]);
    TEST_ASSERT_EQUAL_STRING("-q", call.invocation.operands[1]);
    TEST_ASSERT_EQUAL_INT(10, call.values.terms);
}

static void the_last_of_repeated_options_counts(void)
{
    struct call call;
    PARSE(&call, "scan.exr", "-o", "x", "--terms", "3", "-t5");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, call.result, call.error.text);
    TEST_ASSERT_EQUAL_INT(5, call.values.terms);
}

static void help_is_given_where_the_line_is_incomplete(void)
{
    struct call call;
    PARSE(&call, "--help");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, call.result, call.error.text);
    TEST_ASSERT_TRUE(call.wants_help);
}

static void a_default_that_its_own_option_refuses_is_an_error(void)
{
    static const struct option_spec wrong[] = {{.name = "terms",
                                                .kind = OPTION_INT,
                                                .minimum = 1,
                                                .maximum = 2,
                                                .fallback = "3",
                                                .sentence = "x"},
                                               {0}};
    struct verb verb = factor;
    struct values values = {0};
    struct invocation invocation;
    struct nacre_error error;
    bool wants_help = false;
    struct line line;
    int argc = fill_argv(&line, "factor", (const char *const[]){"scan.exr", NULL});
    verb.options = wrong;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, options_parse(&verb, argc, line.argv, &values, &invocation,
                                                      &wants_help, &error));
    TEST_ASSERT_EQUAL_STRING(
        "the default of an option of factor: --terms: 3 is out of range: 1 to 2", error.text);
}

/* What a run of the program printed and how it ended. */
struct outcome {
    int status; /* of the exit; 128 + signal where one ended it */
    char out[4096], err[4096];
};

static void read_back(FILE *file, char *text, size_t size)
{
    rewind(file);
    text[fread(text, 1, size - 1, file)] = '\0';
    (void)fclose(file);
}

/* Run the program as a process of its own. `out` NULL: standard output is kept in the outcome; "":
 * it is closed; otherwise it goes to the file of that name. */
static struct outcome run_program_to(const char *out_path, const char *const *words)
{
    struct outcome outcome = {0};
    struct line line;
    int argc = fill_argv(&line, "nacre", words), status = 0;
    FILE *out = tmpfile(), *err = tmpfile();
    TEST_ASSERT_NOT_NULL(out);
    TEST_ASSERT_NOT_NULL(err);
    (void)fflush(stdout);
    pid_t child = fork();
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        (void)dup2(fileno(err), STDERR_FILENO);
        if (!out_path) {
            (void)dup2(fileno(out), STDOUT_FILENO);
        } else if (*out_path) {
            (void)dup2(open(out_path, O_WRONLY | O_CLOEXEC), STDOUT_FILENO);
        } else {
            (void)close(STDOUT_FILENO);
        }
        exit(options_run(&program, argc, line.argv)); /* the sanitizers look for leaks at exit */
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    outcome.status = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
    read_back(out, outcome.out, sizeof outcome.out);
    read_back(err, outcome.err, sizeof outcome.err);
    return outcome;
}

#define RUN(...)          run_program_to(NULL, (const char *const[]){__VA_ARGS__, NULL})
#define RUN_TO(path, ...) run_program_to(path, (const char *const[]){__VA_ARGS__, NULL})

static void a_verb_that_succeeds_exits_with_0_and_prints_on_stdout(void)
{
    struct outcome outcome = RUN("factor", "do", "-o", "m", "--terms", "3");
    TEST_ASSERT_EQUAL_INT(0, outcome.status);
    TEST_ASSERT_EQUAL_STRING("terms 3, to m\n", outcome.out);
    TEST_ASSERT_EQUAL_STRING("", outcome.err);
}

/* By any of its names; a file that is not there yet and one that is nobody's are written. */
static void an_output_over_an_argument_is_refused_before_the_verb_runs(void)
{
    char *folder = folder_make(), *name = path_join(folder, "do");
    char *link_name = path_join(folder, "link"), *other = path_join(folder, "other");
    text_write(name, "");
    TEST_ASSERT_EQUAL_INT(0, symlink(name, link_name));
    struct outcome outcome = RUN("factor", name, "-o", link_name);
    TEST_ASSERT_EQUAL_INT(2, outcome.status);
    TEST_ASSERT_EQUAL_STRING("", outcome.out);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(outcome.err, "would be overwritten"), outcome.err);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(outcome.err, link_name), outcome.err);
    outcome = RUN("factor", name, "-o", other);
    TEST_ASSERT_NULL_MESSAGE(strstr(outcome.err, "overwritten"), outcome.err);
    text_write(other, "");
    outcome = RUN("factor", name, "-o", other);
    TEST_ASSERT_NULL_MESSAGE(strstr(outcome.err, "overwritten"), outcome.err);
    TEST_ASSERT_EQUAL_INT(0, unlink(name) | unlink(link_name) | unlink(other) | rmdir(folder));
    free(name);
    free(link_name);
    free(other);
    free(folder);
}

static void a_verb_that_fails_exits_with_1_and_one_message(void)
{
    struct outcome outcome = RUN("factor", "fail", "-o", "m");
    TEST_ASSERT_EQUAL_INT(1, outcome.status);
    TEST_ASSERT_EQUAL_STRING("nacre factor: scan.exr: broken\n", outcome.err);
    TEST_ASSERT_EQUAL_STRING("terms 10, to m\n", outcome.out);
}

static void wrong_usage_exits_with_2_before_the_verb_runs(void)
{
    struct outcome outcome = RUN("factor", "do", "-o", "m", "--terms", "few");
    TEST_ASSERT_EQUAL_INT(2, outcome.status);
    TEST_ASSERT_EQUAL_STRING("", outcome.out);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(outcome.err, "--terms: 'few'"), outcome.err);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(outcome.err, "Try `nacre factor --help`."), outcome.err);
}

static void a_number_out_of_range_exits_with_1_before_the_verb_runs(void)
{
    struct outcome outcome = RUN("factor", "do", "-o", "m", "--terms", "0");
    TEST_ASSERT_EQUAL_INT(1, outcome.status);
    TEST_ASSERT_EQUAL_STRING("", outcome.out);
    TEST_ASSERT_EQUAL_STRING("nacre factor: --terms: 0 is out of range: 1 to 512\n", outcome.err);
}

static void an_unknown_verb_exits_with_2_and_suggests_one(void)
{
    struct outcome outcome = RUN("fcator", "do");
    TEST_ASSERT_EQUAL_INT(2, outcome.status);
    TEST_ASSERT_EQUAL_STRING("nacre: unknown verb 'fcator'; did you mean 'factor'?\n"
                             "Try `nacre --help`.\n",
                             outcome.err);
    outcome = RUN("help", "fcator");
    TEST_ASSERT_EQUAL_INT(2, outcome.status);
    outcome = RUN("xyzzy");
    TEST_ASSERT_EQUAL_STRING("nacre: unknown verb 'xyzzy'\nTry `nacre --help`.\n", outcome.err);
}

static void no_verb_or_an_option_in_its_place_is_wrong_usage(void)
{
    struct outcome outcome = RUN(NULL);
    TEST_ASSERT_EQUAL_INT(2, outcome.status);
    TEST_ASSERT_NOT_NULL(strstr(outcome.err, "which verb?"));
    outcome = RUN("--quiet", "factor");
    TEST_ASSERT_EQUAL_INT(2, outcome.status);
    TEST_ASSERT_NOT_NULL(strstr(outcome.err, "options come behind the verb"));
}

static void ctrl_c_exits_with_130_through_the_verb(void)
{
    struct outcome outcome = RUN("factor", "interrupt", "-o", "m");
    TEST_ASSERT_EQUAL_INT(130, outcome.status);
    TEST_ASSERT_EQUAL_STRING("nacre factor: stopped on request\n", outcome.err);
}

static void a_second_ctrl_c_ends_the_process_at_once(void)
{
    struct outcome outcome = RUN("factor", "ignore", "-o", "m");
    TEST_ASSERT_EQUAL_INT(128 + SIGINT, outcome.status);
    TEST_ASSERT_EQUAL_STRING("", outcome.err); /* by the signal, not by an orderly exit */
}

static void results_that_cannot_be_written_are_a_failure(void)
{
    struct outcome outcome = RUN_TO("/dev/full", "factor", "do", "-o", "m");
    TEST_ASSERT_EQUAL_INT(1, outcome.status);
    TEST_ASSERT_EQUAL_STRING(
        "nacre factor: cannot write to standard output: No space left on device\n", outcome.err);
    outcome = RUN_TO("/dev/full", "--help");
    TEST_ASSERT_EQUAL_INT(1, outcome.status);
    outcome = RUN_TO("", "--version");
    TEST_ASSERT_EQUAL_INT(1, outcome.status);
}

static void a_closed_stdout_does_not_let_results_into_an_output_file(void)
{
    char *folder = folder_make(), *path = path_join(folder, "out");
    size_t size = 99;
    struct outcome outcome = RUN_TO("", "factor", "open", "-o", path);
    uint8_t *bytes = file_read(path, &size);
    TEST_ASSERT_NOT_NULL(bytes);
    TEST_ASSERT_EQUAL_UINT(0, size);
    TEST_ASSERT_EQUAL_INT(1, outcome.status);
    free(bytes);
    free(path);
    folder_remove(folder);
}

static void version_and_help_print_on_stdout_and_exit_with_0(void)
{
    struct outcome outcome = RUN("--version");
    TEST_ASSERT_EQUAL_INT(0, outcome.status);
    TEST_ASSERT_EQUAL_STRING("nacre 1.2.3\n", outcome.out);
    outcome = RUN("--help");
    TEST_ASSERT_EQUAL_INT(0, outcome.status);
    TEST_ASSERT_NOT_NULL(strstr(outcome.out, "factor a scan"));
    TEST_ASSERT_NOT_NULL(strstr(outcome.out, "list devices"));
    struct outcome again = RUN("help");
    TEST_ASSERT_EQUAL_STRING(outcome.out, again.out);
    outcome = RUN("factor", "--help");
    again = RUN("help", "factor");
    TEST_ASSERT_EQUAL_INT(0, outcome.status);
    TEST_ASSERT_EQUAL_STRING(outcome.out, again.out);
}

static void a_verb_without_options_of_its_own_has_the_common_ones(void)
{
    struct outcome outcome = RUN("devices", "--help");
    TEST_ASSERT_EQUAL_INT(0, outcome.status);
    TEST_ASSERT_NOT_NULL(strstr(outcome.out, "--device NAME"));
    outcome = RUN("devices", "--terms", "3");
    TEST_ASSERT_EQUAL_INT(2, outcome.status);
    outcome = RUN("devices", "a");
    TEST_ASSERT_NOT_NULL(strstr(outcome.err, "'a' is one argument too many: devices takes none"));
}

static void expect_narrow_lines(char *text)
{
    for (char *line = strtok(text, "\n"); line; line = strtok(NULL, "\n")) {
        TEST_ASSERT_TRUE_MESSAGE(strlen(line) <= 80, line);
    }
}

static void help_fits_eighty_columns_and_names_range_and_default(void)
{
    struct outcome outcome = RUN("factor", "--help");
    TEST_ASSERT_NOT_NULL(strstr(outcome.out, "Usage: nacre factor SCAN -o MATERIAL [OPTION...]\n"));
    TEST_ASSERT_NOT_NULL(strstr(outcome.out, "  -t, --terms N\n"
                                             "      number of terms; 1 to 512, default 10\n"));
    TEST_ASSERT_NOT_NULL(strstr(outcome.out, "at least 0.01 mm, default 0.5 mm"));
    TEST_ASSERT_NOT_NULL(strstr(outcome.out, "hals, mu or newton, default mu"));
    expect_narrow_lines(outcome.out);
    outcome = RUN("--help");
    TEST_ASSERT_NOT_NULL(strstr(outcome.out, "\n  devices    list devices\n"));
    expect_narrow_lines(outcome.out);
}

static void man_pages_hold_every_option_and_no_stray_roff(void)
{
    struct outcome outcome = RUN("help", "--man", "factor");
    TEST_ASSERT_EQUAL_INT(0, outcome.status);
    TEST_ASSERT_EQUAL_STRING_LEN(".TH \"nacre\\-factor\" 1 ", outcome.out, 22);
    TEST_ASSERT_NOT_NULL(strstr(outcome.out, "\n.PP\n\\&.The second \\e has \\(aqroff\\(aq "
                                             "characters\\-and\\-dashes.\n"));
    for (const struct option_spec *spec = table; spec->name; spec++) {
        char name[32];
        (void)snprintf(name, sizeof name, "\\-\\-%s", spec->name);
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(outcome.out, name), name);
    }
    TEST_ASSERT_NOT_NULL(strstr(outcome.out, "\\-\\-device NAME"));
    outcome = RUN("help", "--man");
    TEST_ASSERT_NOT_NULL(strstr(outcome.out, ".BR nacre\\-factor (1)\n"));
    TEST_ASSERT_NOT_NULL(strstr(outcome.out, ".SH EXIT STATUS\n"));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(parse_fills_in_the_defaults_of_the_table);
    RUN_TEST(parse_reads_every_kind_of_value);
    RUN_TEST(numbers_take_the_suffixes_of_their_kind);
    RUN_TEST(numbers_outside_their_range_are_refused_with_range_and_unit);
    RUN_TEST(texts_that_are_no_numbers_are_refused);
    RUN_TEST(unknown_words_and_options_suggest_the_nearest);
    RUN_TEST(an_unambiguous_beginning_of_an_option_is_enough);
    RUN_TEST(arguments_that_are_missing_or_too_many_are_refused);
    RUN_TEST(two_dashes_end_the_options);
    RUN_TEST(the_last_of_repeated_options_counts);
    RUN_TEST(help_is_given_where_the_line_is_incomplete);
    RUN_TEST(a_default_that_its_own_option_refuses_is_an_error);
    RUN_TEST(a_verb_that_succeeds_exits_with_0_and_prints_on_stdout);
    RUN_TEST(an_output_over_an_argument_is_refused_before_the_verb_runs);
    RUN_TEST(a_verb_that_fails_exits_with_1_and_one_message);
    RUN_TEST(wrong_usage_exits_with_2_before_the_verb_runs);
    RUN_TEST(a_number_out_of_range_exits_with_1_before_the_verb_runs);
    RUN_TEST(an_unknown_verb_exits_with_2_and_suggests_one);
    RUN_TEST(no_verb_or_an_option_in_its_place_is_wrong_usage);
    RUN_TEST(ctrl_c_exits_with_130_through_the_verb);
    RUN_TEST(a_second_ctrl_c_ends_the_process_at_once);
    RUN_TEST(results_that_cannot_be_written_are_a_failure);
    RUN_TEST(a_closed_stdout_does_not_let_results_into_an_output_file);
    RUN_TEST(version_and_help_print_on_stdout_and_exit_with_0);
    RUN_TEST(a_verb_without_options_of_its_own_has_the_common_ones);
    RUN_TEST(help_fits_eighty_columns_and_names_range_and_default);
    RUN_TEST(man_pages_hold_every_option_and_no_stray_roff);
    return UNITY_END();
}
