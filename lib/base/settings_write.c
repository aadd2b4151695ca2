/* Writing a struct as YAML by its schema. */
#include "base/number.h"
#include "base/settings.h"
#include "base/settings_value.h"
#include "nacre/whole_file.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { INDENT = 2 };

static const void *at(const void *base, size_t offset)
{
    return (const char *)base + offset;
}

/* Double-quoted, so that no text can be taken for anything else. */
static void write_string(FILE *file, const char *text)
{
    (void)fputc('"', file);
    for (; *text; text++) {
        unsigned char c = (unsigned char)*text;
        if (c == '"' || c == '\\') {
            (void)fprintf(file, "\\%c", c);
        } else if (c < 0x20 || c == 0x7f) {
            (void)fprintf(file, "\\x%02X", c);
        } else {
            (void)fputc(c, file);
        }
    }
    (void)fputc('"', file);
}

static int write_path(FILE *file, const char *path, struct nacre_error *error)
{
    char *folder = NULL, *whole = NULL;
    if (*path == '/') {
        write_string(file, path);
        return NACRE_OK;
    }
    folder = getcwd(NULL, 0);
    if (!folder) {
        return nacre_fail_errno(error, errno, "the working folder");
    }
    int length = asprintf(&whole, "%s/%s", folder, path);
    free(folder);
    if (length < 0) {
        return nacre_fail_memory(error, path);
    }
    write_string(file, whole);
    free(whole);
    return NACRE_OK;
}

static int write_real(FILE *file, const struct settings_field *field, double value,
                      struct nacre_error *error)
{
    char text[32];
    if (!isfinite(value)) {
        return nacre_fail(error, "'%s' is not finite", field->key);
    }
    number_format(value, text, sizeof text);
    (void)fputs(text, file);
    return NACRE_OK;
}

static int write_reals(FILE *file, const struct settings_field *field, const double *values,
                       size_t count, struct nacre_error *error)
{
    (void)fputc('[', file);
    for (size_t i = 0; i < count; i++) {
        (void)fputs(i ? ", " : "", file);
        if (write_real(file, field, values[i], error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    (void)fputc(']', file);
    return NACRE_OK;
}

static void write_strings(FILE *file, char *const *texts, size_t count)
{
    (void)fputc('[', file);
    for (size_t i = 0; i < count; i++) {
        (void)fputs(i ? ", " : "", file);
        write_string(file, texts[i]);
    }
    (void)fputc(']', file);
}

static int write_choice(FILE *file, const struct settings_field *field, int value,
                        struct nacre_error *error)
{
    int count = 0;
    while (field->words[count]) {
        count++;
    }
    if (value < 0 || value >= count) {
        return nacre_fail(error, "'%s' has no word of index %d", field->key, value);
    }
    (void)fputs(field->words[value], file);
    return NACRE_OK;
}

static int write_fields(FILE *file, const struct settings_schema *schema, const void *in,
                        int indent, bool is_item, struct nacre_error *error);

static int write_list(FILE *file, const struct settings_field *field, const char *items,
                      size_t count, int indent, struct nacre_error *error)
{
    (void)fputs(count ? "\n" : " []\n", file);
    for (size_t i = 0; i < count; i++) {
        if (write_fields(file, field->schema, items + i * field->schema->size, indent, true,
                         error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

/* What stands behind "key:" on the same line. */
static int write_value(FILE *file, const struct settings_field *field, const void *in,
                       struct nacre_error *error)
{
    const void *value = at(in, field->offset);
    size_t length = 0;
    switch (field->kind) {
    case SETTINGS_BOOL:
        (void)fputs(*(const bool *)value ? "true" : "false", file);
        return NACRE_OK;
    case SETTINGS_INT:
        (void)fprintf(file, "%d", *(const int *)value);
        return NACRE_OK;
    case SETTINGS_REAL:
        return write_real(file, field, *(const double *)value, error);
    case SETTINGS_STRING:
        write_string(file, *(char *const *)value);
        return NACRE_OK;
    case SETTINGS_PATH:
        return write_path(file, *(char *const *)value, error);
    case SETTINGS_CHOICE:
        return write_choice(file, field, *(const int *)value, error);
    case SETTINGS_REALS:
        return write_reals(file, field, value, field->count, error);
    case SETTINGS_NUMBERS:
        length = *(const size_t *)at(in, field->length_offset);
        return write_reals(file, field, *(double *const *)value, length, error);
    case SETTINGS_STRINGS:
        length = *(const size_t *)at(in, field->length_offset);
        write_strings(file, *(char **const *)value, length);
        return NACRE_OK;
    case SETTINGS_STRUCT:
    case SETTINGS_LIST:
        break;
    }
    return nacre_fail(error, "'%s' is no scalar", field->key);
}

/* Whether an optional struct that requires keys is as it is where it is left out: written it would be refused. */
static bool is_absent_struct(const struct settings_field *field, const void *in)
{
    char where[8];
    bool same = false, requires_keys = false;
    const struct settings_source source = {.name = "defaults"};
    for (const struct settings_field *inner = field->schema->fields; inner->key; inner++) {
        requires_keys = requires_keys || inner->required;
    }
    void *absent = requires_keys ? calloc(1, field->schema->size) : NULL;
    if (!absent) {
        return false;
    }
    if (settings_apply_defaults(&source, field->schema, absent, NULL) == NACRE_OK) {
        same = settings_same(field->schema, at(in, field->offset), absent, where, sizeof where);
    }
    settings_finish(field->schema, absent);
    free(absent);
    return same;
}

/* Whether numbers are 0 because nothing was said: it is their default, but may not be typed. */
static bool is_unsaid(const struct settings_field *field, const double *values, size_t count)
{
    bool unsaid = !field->required && !field->fallback &&
                  !number_is_within(0, field->minimum, field->maximum);
    for (size_t i = 0; i < count; i++) {
        unsaid = unsaid && values[i] == 0;
    }
    return unsaid;
}

static bool is_left_out(const struct settings_field *field, const void *in)
{
    double number = 0;
    switch (field->kind) {
    case SETTINGS_INT:
        number = *(const int *)at(in, field->offset);
        return is_unsaid(field, &number, 1);
    case SETTINGS_REAL:
        return is_unsaid(field, at(in, field->offset), 1);
    case SETTINGS_REALS:
        return is_unsaid(field, at(in, field->offset), field->count);
    case SETTINGS_STRING:
    case SETTINGS_PATH:
        return !*(char *const *)at(in, field->offset);
    case SETTINGS_STRUCT:
        return !field->required && is_absent_struct(field, in);
    default:
        return false;
    }
}

static int write_field(FILE *file, const struct settings_field *field, const void *in, int indent,
                       struct nacre_error *error)
{
    if (field->kind == SETTINGS_STRUCT) {
        (void)fputc('\n', file);
        return write_fields(file, field->schema, at(in, field->offset), indent + INDENT, false,
                            error);
    }
    if (field->kind == SETTINGS_LIST) {
        return write_list(file, field, *(char *const *)at(in, field->offset),
                          *(const size_t *)at(in, field->length_offset), indent + INDENT, error);
    }
    (void)fputc(' ', file);
    int result = write_value(file, field, in, error);
    (void)fputc('\n', file);
    return result;
}

/* The fields of one mapping; the first one of a list's item stands behind a dash. */
static int write_fields(FILE *file, const struct settings_schema *schema, const void *in,
                        int indent, bool is_item, struct nacre_error *error)
{
    bool first = true;
    for (const struct settings_field *field = schema->fields; field->key; field++) {
        if (is_left_out(field, in)) {
            continue;
        }
        (void)fprintf(file, "%*s%s%s:", indent, "",
                      !is_item ? ""
                      : first  ? "- "
                               : "  ",
                      field->key);
        first = false;
        if (write_field(file, field, in, indent + (is_item ? INDENT : 0), error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    if (first) {
        (void)fprintf(file, "%*s%s{}\n", indent, "", is_item ? "- " : "");
    }
    return NACRE_OK;
}

/* Read the text back, so that no file is left that settings_read refuses. */
static int check_text(const char *path, const char *text, size_t size,
                      const struct settings_schema *schema, struct nacre_error *error)
{
    void *again = calloc(1, schema->size);
    if (!again) {
        return nacre_fail_memory(error, path);
    }
    int result = settings_parse(path, NULL, text, size, schema, again, error);
    settings_finish(schema, again);
    free(again);
    return result;
}

int settings_text(const struct settings_schema *schema, const void *in, char **text, size_t *size,
                  struct nacre_error *error)
{
    *text = NULL;
    FILE *file = open_memstream(text, size);
    if (!file) {
        return nacre_fail_memory(error, schema->what);
    }
    int result = write_fields(file, schema, in, 0, false, error);
    if (fclose(file) != 0 && result == NACRE_OK) {
        result = nacre_fail_memory(error, schema->what);
    }
    return result;
}

int settings_write(const char *path, const struct settings_schema *schema, const void *in,
                   struct nacre_error *error)
{
    char *text = NULL;
    size_t size = 0;
    int result = settings_text(schema, in, &text, &size, error);
    if (result == NACRE_OK) {
        result = check_text(path, text, size, schema, error);
    }
    if (result == NACRE_OK) {
        result = whole_file_write(path, text, size, error);
    } else {
        (void)nacre_fail_within(error, "cannot write %s", path);
    }
    free(text);
    return result;
}
