/* The text of --help and the man pages, made from the tables. */
#include "base/options_table.h"

#include <stdlib.h>
#include <string.h>

enum { WIDTH = 80, INDENT = 6, VERB_WIDTH = 10 };

/* "--terms N", "-o, --output FILE". */
static void name_option(const struct option_spec *spec, char *text, size_t size)
{
    char letter[] = {'-', spec->letter, ',', ' ', '\0'};
    const char *argument = spec->argument ? spec->argument : "WORD";
    bool takes_argument = spec->kind != OPTION_FLAG;
    (void)snprintf(text, size, "%s--%s%s%s", spec->letter ? letter : "", spec->name,
                   takes_argument ? " " : "", takes_argument ? argument : "");
}

/* "the number of terms; 1 to 512, default 10". */
static void describe_option(const struct option_spec *spec, char *text, size_t size)
{
    char values[256];
    options_describe_values(spec, values, sizeof values);
    const char *fallback = spec->fallback;
    (void)snprintf(text, size, "%s%s%s%s%s%s%s", spec->sentence, *values ? "; " : "", values,
                   fallback ? (*values ? ", default " : "; default ") : "",
                   fallback ? fallback : "", fallback && spec->unit ? " " : "",
                   fallback && spec->unit ? spec->unit : "");
}

/* Print paragraphs filled to WIDTH with `indent` blanks before each line; `column` characters stand in the first one. */
static void print_filled(const char *text, int indent, int column, FILE *file)
{
    while (*text) {
        int length = (int)strcspn(text, " \n");
        if (length && column && column + 1 + length > WIDTH) {
            (void)fputc('\n', file);
            column = 0;
        }
        if (length) {
            column += column ? fprintf(file, " %.*s", length, text)
                             : fprintf(file, "%*s%.*s", indent, "", length, text);
        }
        text += length;
        if (strncmp(text, "\n\n", 2) == 0) {
            (void)fputs("\n\n", file);
            column = 0;
        }
        text += strspn(text, " \n");
    }
    (void)fputc('\n', file);
}

static void print_table(const struct option_spec *table, FILE *file)
{
    for (; table && table->name; table++) {
        char name[128], text[1024];
        name_option(table, name, sizeof name);
        describe_option(table, text, sizeof text);
        (void)fprintf(file, "  %s\n", name);
        print_filled(text, INDENT, 0, file);
    }
}

static void print_program_help(const struct program *program, FILE *file)
{
    print_filled(program->summary, 0, fprintf(file, "%s -", program->name), file);
    (void)fprintf(file, "\nUsage: %s VERB [OPTION...] [ARGUMENT...]\n\nVerbs:\n", program->name);
    for (const struct verb *const *verb = program->verbs; *verb; verb++) {
        print_filled((*verb)->summary, VERB_WIDTH + 3,
                     fprintf(file, "  %-*s", VERB_WIDTH, (*verb)->name), file);
    }
    (void)fprintf(
        file,
        "  %-10s %s\n\n`%s VERB --help` prints a verb's options, `%s --version` the version.\n",
        "help", "print this text, or a verb's", program->name, program->name);
}

void options_print_help(const struct program *program, const struct verb *verb, FILE *file)
{
    if (!verb) {
        print_program_help(program, file);
        return;
    }
    const char *operands = verb->operands ? verb->operands : "";
    print_filled(verb->summary, 0, fprintf(file, "%s %s -", program->name, verb->name), file);
    (void)fprintf(file, "\nUsage: %s %s%s%s [OPTION...]\n", program->name, verb->name,
                  *operands ? " " : "", operands);
    if (verb->text && *verb->text) {
        (void)fputc('\n', file);
        print_filled(verb->text, 0, 0, file);
    }
    (void)fputs("\nOptions:\n", file);
    print_table(verb->options, file);
    print_table(options_common_table, file);
}

/* Text with roff's own characters made harmless; a blank line begins a paragraph. */
static void print_roff(const char *text, FILE *file)
{
    bool at_start = true;
    for (; *text; text++) {
        if (text[0] == '\n' && text[1] == '\n') {
            (void)fputs("\n.PP\n", file);
            text++;
            at_start = true;
        } else if (*text == '\n') {
            (void)fputc('\n', file);
            at_start = true;
        } else {
            if (at_start && (*text == '.' || *text == '\'')) {
                (void)fputs("\\&", file);
            }
            (void)fputs(*text == '\\'   ? "\\e"
                        : *text == '-'  ? "\\-"
                        : *text == '\'' ? "\\(aq"
                        : *text == '`'  ? "\\(ga"
                                        : "",
                        file);
            if (!strchr("\\-'`", *text)) {
                (void)fputc(*text, file);
            }
            at_start = false;
        }
    }
    if (!at_start) {
        (void)fputc('\n', file);
    }
}

static void print_roff_table(const struct option_spec *table, FILE *file)
{
    for (; table && table->name; table++) {
        char name[128], text[1024];
        name_option(table, name, sizeof name);
        describe_option(table, text, sizeof text);
        (void)fputs(".TP\n.B ", file);
        print_roff(name, file);
        print_roff(text, file);
    }
}

static void print_verb_man(const struct program *program, const struct verb *verb, FILE *file)
{
    (void)fprintf(file, ".SH NAME\n%s\\-%s \\- ", program->name, verb->name);
    print_roff(verb->summary, file);
    (void)fprintf(file, ".SH SYNOPSIS\n.B %s %s\n", program->name, verb->name);
    print_roff(verb->operands ? verb->operands : "", file);
    (void)fputs("[OPTION...]\n", file);
    if (verb->text && *verb->text) {
        (void)fputs(".SH DESCRIPTION\n", file);
        print_roff(verb->text, file);
    }
    (void)fputs(".SH OPTIONS\n", file);
    print_roff_table(verb->options, file);
    print_roff_table(options_common_table, file);
}

static void print_program_man(const struct program *program, FILE *file)
{
    (void)fprintf(file, ".SH NAME\n%s \\- ", program->name);
    print_roff(program->summary, file);
    (void)fprintf(file,
                  ".SH SYNOPSIS\n.B %s\nVERB [OPTION...] [ARGUMENT...]\n"
                  ".SH VERBS\n",
                  program->name);
    for (const struct verb *const *verb = program->verbs; *verb; verb++) {
        (void)fprintf(file, ".TP\n.BR %s\\-%s (1)\n", program->name, (*verb)->name);
        print_roff((*verb)->summary, file);
    }
    (void)fputs(".SH OPTIONS\nEvery verb takes these beside its own.\n", file);
    print_roff_table(options_common_table, file);
    (void)fputs(
        ".SH ENVIRONMENT\n"
        ".TP\n.B NACRE_DEVICE\nThe OpenCL device to compute on where \\-\\-device is not given.\n"
        ".TP\n.B NACRE_CL_DIR\nA folder whose OpenCL sources are used instead of the built\\-in "
        "ones of the same name.\n"
        ".TP\n.B SOURCE_DATE_EPOCH\nWhere it is set, no output holds how long its making took, so "
        "that equal inputs give equal files.\n",
        file);
}

void options_print_man(const struct program *program, const struct verb *verb, FILE *file)
{
    (void)fprintf(file, ".TH \"%s%s%s\" 1 \"\" \"%s %s\"\n", program->name, verb ? "\\-" : "",
                  verb ? verb->name : "", program->name, program->version);
    if (verb) {
        print_verb_man(program, verb, file);
    } else {
        print_program_man(program, file);
    }
    (void)fputs(".SH EXIT STATUS\n0 done, 1 failed, 2 wrong usage, 130 stopped by the user.\n",
                file);
    if (verb) {
        (void)fprintf(file, ".SH SEE ALSO\n.BR %s (1)\n", program->name);
    }
}
