/* Turning an option's argument into its value, strictly. */
#include "base/nearest.h"
#include "base/number.h"
#include "base/options_table.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

struct suffix {
    const char *text;
    double factor;
};

static const struct suffix *suffixes_of(enum option_kind kind)
{
    static const struct suffix none[] = {{"", 1}, {NULL, 0}};
    static const struct suffix percent[] = {{"", 1}, {"%", 0.01}, {NULL, 0}};
    static const struct suffix seconds[] = {{"", 1},     {"s", 1},    {"ms", 0.001},
                                            {"min", 60}, {"h", 3600}, {NULL, 0}};
    static const struct suffix bytes[] = {{"", 1},         {"B", 1},        {"k", 0x1p10},
                                          {"K", 0x1p10},   {"KiB", 0x1p10}, {"M", 0x1p20},
                                          {"MiB", 0x1p20}, {"G", 0x1p30},   {"GiB", 0x1p30},
                                          {"T", 0x1p40},   {"TiB", 0x1p40}, {NULL, 0}};
    return kind == OPTION_REAL      ? percent
           : kind == OPTION_SECONDS ? seconds
           : kind == OPTION_BYTES   ? bytes
                                    : none;
}

static const char *form_of(enum option_kind kind)
{
    return kind == OPTION_INT       ? "a whole number"
           : kind == OPTION_SECONDS ? "a time: a number, then ms, s, min, h or nothing for seconds"
           : kind == OPTION_BYTES ? "a size: a number, then K, M, G (of 1024) or nothing for bytes"
                                  : "a number";
}

static int refuse_form(const struct option_spec *spec, const char *text, struct nacre_error *error)
{
    return nacre_fail(error, "--%s: '%s' is not %s", spec->name, text, form_of(spec->kind));
}

/* A size or time as people write it: 4294967296 bytes are "4 G". */
static void format_bytes(double value, char *text, size_t size)
{
    static const char units[] = "\0KMGT";
    int unit = 0;
    char number[32];
    while (unit < 4 && value >= 1024 && fmod(value, 1024) == 0) {
        value /= 1024;
        unit++;
    }
    number_format(value, number, sizeof number);
    (void)snprintf(text, size, "%s%.1s", number, units + unit);
}

static void describe_range(const struct option_spec *spec, char *text, size_t size)
{
    const char *unit = spec->unit ? spec->unit : spec->kind == OPTION_SECONDS ? "s" : NULL;
    if (spec->kind == OPTION_BYTES && (spec->minimum != 0 || spec->maximum != 0)) {
        char low[40], high[40];
        format_bytes(spec->minimum, low, sizeof low);
        format_bytes(spec->maximum, high, sizeof high);
        (void)snprintf(text, size, isfinite(spec->maximum) ? "%s to %s bytes" : "at least %s bytes",
                       low, high);
        return;
    }
    number_describe_range(spec->minimum, spec->maximum, unit, text, size);
}

void options_describe_values(const struct option_spec *spec, char *text, size_t size)
{
    size_t used = 0;
    text[0] = '\0';
    if (spec->kind != OPTION_CHOICE) {
        describe_range(spec, text, size);
        return;
    }
    for (int i = 0; spec->words[i] && used < size; i++) {
        const char *gap = i == 0 ? "" : spec->words[i + 1] ? ", " : " or ";
        int written = snprintf(text + used, size - used, "%s%s", gap, spec->words[i]);
        used += written > 0 ? (size_t)written : 0;
    }
}

static int refuse_range(const struct option_spec *spec, const char *text, struct nacre_error *error)
{
    char range[128];
    describe_range(spec, range, sizeof range);
    if (!*range) {
        (void)snprintf(range, sizeof range, "%s",
                       spec->kind == OPTION_INT ? "-2147483648 to 2147483647" : "at least 0");
    }
    (void)nacre_fail(error, "--%s: %s is out of range: %s", spec->name, text, range);
    return OPTIONS_OUT_OF_RANGE;
}

static int set_int(const struct option_spec *spec, const char *text, int *value,
                   struct nacre_error *error)
{
    enum number_status status = number_parse_int(text, value);
    if (status == NUMBER_MALFORMED) {
        return refuse_form(spec, text, error);
    }
    if (status == NUMBER_TOO_LARGE || !number_is_within(*value, spec->minimum, spec->maximum)) {
        return refuse_range(spec, text, error);
    }
    return NACRE_OK;
}

static int set_real(const struct option_spec *spec, const char *text, double *value,
                    struct nacre_error *error)
{
    const char *rest = NULL;
    double number = 0;
    enum number_status status = number_read(text, &number, &rest);
    if (status == NUMBER_MALFORMED) {
        return refuse_form(spec, text, error);
    }
    rest += *rest == ' ' && rest[1];
    const struct suffix *suffix = suffixes_of(spec->kind);
    while (suffix->text && strcmp(suffix->text, rest) != 0) {
        suffix++;
    }
    if (!suffix->text) {
        return refuse_form(spec, text, error);
    }
    /* Dividing keeps "2%" the double nearest to 0.02. */
    number = suffix->factor < 1 ? number / round(1 / suffix->factor) : number * suffix->factor;
    bool is_quantity = spec->kind == OPTION_SECONDS || spec->kind == OPTION_BYTES;
    if (!isfinite(number) || (is_quantity && number < 0) ||
        !number_is_within(number, spec->minimum, spec->maximum)) {
        return refuse_range(spec, text, error);
    }
    *value = number;
    return NACRE_OK;
}

static int set_choice(const struct option_spec *spec, const char *text, int *value,
                      struct nacre_error *error)
{
    char words[256];
    struct nearest nearest = nearest_begin(text);
    for (int i = 0; spec->words[i]; i++) {
        if (strcmp(spec->words[i], text) == 0) {
            *value = i;
            return NACRE_OK;
        }
        nearest_offer(&nearest, spec->words[i]);
    }
    options_describe_values(spec, words, sizeof words);
    if (nearest.best) {
        return nacre_fail(error, "--%s: '%s' is not %s; did you mean '%s'?", spec->name, text,
                          words, nearest.best);
    }
    return nacre_fail(error, "--%s: '%s' is not %s", spec->name, text, words);
}

int options_set_value(const struct option_spec *spec, const char *text, void *settings,
                      struct nacre_error *error)
{
    void *value = (char *)settings + spec->offset;
    switch (spec->kind) {
    case OPTION_FLAG:
        *(bool *)value = true;
        return NACRE_OK;
    case OPTION_INT:
        return set_int(spec, text, value, error);
    case OPTION_REAL:
    case OPTION_SECONDS:
    case OPTION_BYTES:
        return set_real(spec, text, value, error);
    case OPTION_STRING:
        *(const char **)value = text;
        return NACRE_OK;
    case OPTION_CHOICE:
        return set_choice(spec, text, value, error);
    }
    return nacre_fail(error, "--%s: the table of options names no kind", spec->name);
}
