/* Scalars and sequences of scalars: from a YAML node to a member of a struct, checked against the field. */
#include "base/settings_value.h"

#include "base/nearest.h"
#include "base/number.h"

#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int settings_fail_at(const struct settings_source *source, yaml_mark_t mark,
                     struct nacre_error *error, const char *format, ...)
{
    char text[sizeof error->text];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    return nacre_fail(error, "%s:%zu:%zu: %s", source->name, mark.line + 1, mark.column + 1, text);
}

/* The text of a scalar, or NULL with the error set. A plain empty scalar, ~ and null are no value.
 */
static const char *scalar_text(const struct settings_source *source, const char *key,
                               const yaml_node_t *node, const char *wanted,
                               struct nacre_error *error)
{
    if (node->type != YAML_SCALAR_NODE) {
        (void)settings_fail_at(source, node->start_mark, error, "'%s' is %s, not %s", key,
                               node->type == YAML_MAPPING_NODE ? "a mapping" : "a sequence",
                               wanted);
        return NULL;
    }
    const char *text = (const char *)node->data.scalar.value;
    bool plain = node->data.scalar.style == YAML_PLAIN_SCALAR_STYLE;
    if (plain && (!*text || strcmp(text, "~") == 0 || strcmp(text, "null") == 0)) {
        (void)settings_fail_at(source, node->start_mark, error,
                               "'%s' has no value; it takes %s, or leave the key out", key, wanted);
        return NULL;
    }
    if (strlen(text) != node->data.scalar.length) {
        (void)settings_fail_at(source, node->start_mark, error,
                               "the value of '%s' holds a character of code 0", key);
        return NULL;
    }
    return text;
}

static bool is_plain(const yaml_node_t *node)
{
    return node->data.scalar.style == YAML_PLAIN_SCALAR_STYLE;
}

static int refuse_range(const struct settings_source *source, const struct settings_field *field,
                        const yaml_node_t *node, const char *text, struct nacre_error *error)
{
    char range[128];
    const char *sentence = field->sentence;
    number_describe_range(field->minimum, field->maximum, NULL, range, sizeof range);
    if (!*range && field->kind == SETTINGS_INT) {
        (void)snprintf(range, sizeof range, "%d to %d", INT_MIN, INT_MAX);
    }
    return settings_fail_at(source, node->start_mark, error, "%s: %s is out of range%s%s%s%s%s",
                            field->key, text, *range ? ": " : "", range, sentence ? " (" : "",
                            sentence ? sentence : "", sentence ? ")" : "");
}

static int set_bool(const struct settings_source *source, const struct settings_field *field,
                    const yaml_node_t *node, bool *value, struct nacre_error *error)
{
    static const char *const words[] = {"false", "true", "no", "yes", "off", "on"};
    const char *text = scalar_text(source, field->key, node, "true or false", error);
    if (!text) {
        return NACRE_FAILED;
    }
    for (size_t i = 0; i < sizeof words / sizeof words[0] && is_plain(node); i++) {
        if (strcmp(text, words[i]) == 0) {
            *value = i % 2 == 1;
            return NACRE_OK;
        }
    }
    return settings_fail_at(source, node->start_mark, error, "%s: '%s' is not true or false",
                            field->key, text);
}

static int set_int(const struct settings_source *source, const struct settings_field *field,
                   const yaml_node_t *node, int *value, struct nacre_error *error)
{
    const char *text = scalar_text(source, field->key, node, "a whole number", error);
    if (!text) {
        return NACRE_FAILED;
    }
    enum number_status status = is_plain(node) ? number_parse_int(text, value) : NUMBER_MALFORMED;
    if (status == NUMBER_MALFORMED) {
        return settings_fail_at(source, node->start_mark, error, "%s: '%s' is not a whole number",
                                field->key, text);
    }
    if (status == NUMBER_TOO_LARGE || !number_is_within(*value, field->minimum, field->maximum)) {
        return refuse_range(source, field, node, text, error);
    }
    return NACRE_OK;
}

static int set_real(const struct settings_source *source, const struct settings_field *field,
                    const yaml_node_t *node, double *value, struct nacre_error *error)
{
    const char *text = scalar_text(source, field->key, node, "a number", error);
    if (!text) {
        return NACRE_FAILED;
    }
    enum number_status status = is_plain(node) ? number_parse(text, value) : NUMBER_MALFORMED;
    if (status == NUMBER_MALFORMED) {
        return settings_fail_at(source, node->start_mark, error, "%s: '%s' is not a number",
                                field->key, text);
    }
    if (status == NUMBER_TOO_LARGE || !number_is_within(*value, field->minimum, field->maximum)) {
        return refuse_range(source, field, node, text, error);
    }
    return NACRE_OK;
}

static int set_string(const struct settings_source *source, const char *key,
                      const yaml_node_t *node, char **value, struct nacre_error *error)
{
    const char *text = scalar_text(source, key, node, "a text", error);
    if (!text) {
        return NACRE_FAILED;
    }
    *value = strdup(text);
    return *value ? NACRE_OK : nacre_fail_memory(error, source->name);
}

static int set_path(const struct settings_source *source, const char *key, const yaml_node_t *node,
                    char **value, struct nacre_error *error)
{
    const char *text = scalar_text(source, key, node, "a path", error);
    if (!text) {
        return NACRE_FAILED;
    }
    if (!*text) {
        return settings_fail_at(source, node->start_mark, error, "%s: the path is empty", key);
    }
    if (*text == '/' || !source->folder || !*source->folder) {
        *value = strdup(text);
    } else if (asprintf(value, "%s/%s", source->folder, text) < 0) {
        *value = NULL;
    }
    return *value ? NACRE_OK : nacre_fail_memory(error, source->name);
}

static int set_choice(const struct settings_source *source, const struct settings_field *field,
                      const yaml_node_t *node, int *value, struct nacre_error *error)
{
    char known[512] = "";
    size_t used = 0;
    const char *text = scalar_text(source, field->key, node, "a word", error);
    if (!text) {
        return NACRE_FAILED;
    }
    struct nearest nearest = nearest_begin(text);
    for (int i = 0; field->words[i]; i++) {
        if (strcmp(field->words[i], text) == 0) {
            *value = i;
            return NACRE_OK;
        }
        nearest_offer(&nearest, field->words[i]);
        if (used < sizeof known) {
            used += (size_t)snprintf(known + used, sizeof known - used, "%s%s", i ? ", " : "",
                                     field->words[i]);
        }
    }
    return settings_fail_at(source, node->start_mark, error,
                            "%s: '%s' is not one of its words%s%s%s; they are: %s", field->key,
                            text, nearest.best ? ", perhaps '" : "",
                            nearest.best ? nearest.best : "", nearest.best ? "'" : "", known);
}

static size_t item_count(const yaml_node_t *node)
{
    return (size_t)(node->data.sequence.items.top - node->data.sequence.items.start);
}

static const yaml_node_t *item_node(const struct settings_source *source, const yaml_node_t *node,
                                    size_t i)
{
    return yaml_document_get_node(source->document, node->data.sequence.items.start[i]);
}

static int set_reals(const struct settings_source *source, const struct settings_field *field,
                     const yaml_node_t *node, double *values, struct nacre_error *error)
{
    if (node->type == YAML_SCALAR_NODE) {
        if (set_real(source, field, node, &values[0], error) != NACRE_OK) {
            return NACRE_FAILED;
        }
        for (size_t i = 1; i < field->count; i++) {
            values[i] = values[0];
        }
        return NACRE_OK;
    }
    if (node->type != YAML_SEQUENCE_NODE || item_count(node) != field->count) {
        return settings_fail_at(source, node->start_mark, error,
                                "'%s' takes a sequence of %zu numbers, or one number for all",
                                field->key, field->count);
    }
    for (size_t i = 0; i < field->count; i++) {
        if (set_real(source, field, item_node(source, node, i), &values[i], error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

static int set_numbers(const struct settings_source *source, const struct settings_field *field,
                       const yaml_node_t *node, double **values, size_t *length,
                       struct nacre_error *error)
{
    if (node->type != YAML_SEQUENCE_NODE) {
        return settings_fail_at(source, node->start_mark, error, "'%s' takes a sequence of numbers",
                                field->key);
    }
    size_t count = item_count(node);
    *values = calloc(count ? count : 1, sizeof **values);
    if (!*values) {
        return nacre_fail_memory(error, source->name);
    }
    *length = count;
    for (size_t i = 0; i < count; i++) {
        if (set_real(source, field, item_node(source, node, i), &(*values)[i], error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

static int set_strings(const struct settings_source *source, const struct settings_field *field,
                       const yaml_node_t *node, char ***values, size_t *length,
                       struct nacre_error *error)
{
    if (node->type != YAML_SEQUENCE_NODE) {
        return settings_fail_at(source, node->start_mark, error, "'%s' takes a sequence of texts",
                                field->key);
    }
    size_t count = item_count(node);
    *values = calloc(count ? count : 1, sizeof **values);
    if (!*values) {
        return nacre_fail_memory(error, source->name);
    }
    *length = count;
    for (size_t i = 0; i < count; i++) {
        const yaml_node_t *item = item_node(source, node, i);
        int word;
        if ((field->words && set_choice(source, field, item, &word, error) != NACRE_OK) ||
            set_string(source, field->key, item, &(*values)[i], error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

int settings_set_value(const struct settings_source *source, const struct settings_field *field,
                       const yaml_node_t *node, void *out, struct nacre_error *error)
{
    void *value = (char *)out + field->offset;
    size_t *length = (size_t *)(void *)((char *)out + field->length_offset);
    switch (field->kind) {
    case SETTINGS_BOOL:
        return set_bool(source, field, node, value, error);
    case SETTINGS_INT:
        return set_int(source, field, node, value, error);
    case SETTINGS_REAL:
        return set_real(source, field, node, value, error);
    case SETTINGS_STRING:
        return set_string(source, field->key, node, value, error);
    case SETTINGS_PATH:
        return set_path(source, field->key, node, value, error);
    case SETTINGS_CHOICE:
        return set_choice(source, field, node, value, error);
    case SETTINGS_REALS:
        return set_reals(source, field, node, value, error);
    case SETTINGS_NUMBERS:
        return set_numbers(source, field, node, value, length, error);
    case SETTINGS_STRINGS:
        return set_strings(source, field, node, value, length, error);
    case SETTINGS_STRUCT:
    case SETTINGS_LIST:
        break;
    }
    return nacre_fail(error, "%s: '%s' is no scalar", source->name, field->key);
}
