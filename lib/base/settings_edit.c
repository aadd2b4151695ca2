/* Editing settings files in place. */
#include "base/settings_edit.h"

#include "nacre/whole_file.h"

#include <errno.h>
#include <libgen.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <yaml.h>

/* Larger files are no settings. */
enum { MOST_BYTES = 1 << 22 };

/* A stretch of the text and what comes in its place. */
struct change {
    size_t from, to;
    char text[256];
};

static int read_text(const char *path, char **text, struct nacre_error *error)
{
    int status = NACRE_OK;
    FILE *file = fopen(path, "r");
    *text = calloc(MOST_BYTES + 1, 1);
    if (!file) {
        status = nacre_fail_errno(error, errno, "%s: cannot open", path);
    } else if (!*text) {
        status = nacre_fail_memory(error, path);
    } else if (fread(*text, 1, MOST_BYTES, file) != strlen(*text) || strlen(*text) == MOST_BYTES ||
               ferror(file)) {
        status = nacre_fail(error, "%s: cannot be read, or is no settings file", path);
    }
    if (file) {
        (void)fclose(file); /* was only read */
    }
    return status;
}

/* libyaml counts characters, but for a byte order mark. */
static size_t byte_of(const char *text, size_t character)
{
    static const char mark[] = "\xEF\xBB\xBF";
    size_t at = strncmp(text, mark, strlen(mark)) == 0 ? strlen(mark) : 0;
    for (size_t i = 0; i < character && text[at]; i++) {
        at++;
        while (((unsigned char)text[at] & 0xC0) == 0x80) {
            at++;
        }
    }
    return at;
}

static yaml_node_t *find_value(yaml_document_t *document, const yaml_node_t *mapping,
                               const char *key, size_t length)
{
    for (yaml_node_pair_t *pair = mapping->data.mapping.pairs.start;
         pair < mapping->data.mapping.pairs.top; pair++) {
        yaml_node_t *name = yaml_document_get_node(document, pair->key);
        if (name->type == YAML_SCALAR_NODE && name->data.scalar.length == length &&
            memcmp(name->data.scalar.value, key, length) == 0) {
            return yaml_document_get_node(document, pair->value);
        }
    }
    return NULL;
}

/* "egl: {latency_ms: 16}" for the rest of a key. */
static void write_entry(const char *key, double value, char *text, size_t size)
{
    size_t used = 0;
    int depth = 0;
    for (const char *dot = strchr(key, '.'); dot; dot = strchr(key, '.')) {
        used += (size_t)snprintf(text + used, size - used, "%.*s: {", (int)(dot - key), key);
        key = dot + 1;
        depth++;
    }
    used += (size_t)snprintf(text + used, size - used, "%s: %.6g", key, value);
    while (depth-- > 0) {
        used += (size_t)snprintf(text + used, size - used, "}");
    }
}

/* A new key comes first in its mapping. */
static void insert(yaml_document_t *document, const char *text, const yaml_node_t *mapping,
                   const struct settings_edit *edit, const char *rest, struct change *change)
{
    char entry[160];
    bool empty = mapping->data.mapping.pairs.start == mapping->data.mapping.pairs.top;
    write_entry(rest, edit->value, entry, sizeof entry);
    if (mapping->data.mapping.style == YAML_FLOW_MAPPING_STYLE || empty) {
        change->from = change->to = byte_of(text, mapping->start_mark.index) + 1;
        (void)snprintf(change->text, sizeof change->text, "%s%s", entry, empty ? "" : ", ");
        return;
    }
    const yaml_node_t *first =
        yaml_document_get_node(document, mapping->data.mapping.pairs.start->key);
    change->from = change->to = byte_of(text, first->start_mark.index);
    (void)snprintf(change->text, sizeof change->text, "%s\n%*s", entry,
                   (int)first->start_mark.column, "");
}

static int find_change(yaml_document_t *document, const char *text,
                       const struct settings_edit *edit, struct change *change,
                       struct nacre_error *error)
{
    yaml_node_t *node = yaml_document_get_root_node(document);
    const char *rest = edit->key;
    if (!node || node->type != YAML_MAPPING_NODE) {
        return nacre_fail(error, "is no settings file");
    }
    for (;;) {
        size_t length = strcspn(rest, ".");
        yaml_node_t *value = find_value(document, node, rest, length);
        if (!value) {
            insert(document, text, node, edit, rest, change);
            return NACRE_OK;
        }
        rest += length;
        if (*rest == '.' && value->type == YAML_MAPPING_NODE) {
            rest++;
            node = value;
        } else if (*rest == '\0' && value->type == YAML_SCALAR_NODE) {
            change->from = byte_of(text, value->start_mark.index);
            change->to = byte_of(text, value->end_mark.index);
            bool empty = change->from == change->to; /* "key:", which ends at the colon */
            (void)snprintf(change->text, sizeof change->text, "%s%.6g", empty ? " " : "",
                           edit->value);
            return NACRE_OK;
        } else {
            return nacre_fail(error, "line %zu: %s is not written as it should be",
                              value->start_mark.line + 1, edit->key);
        }
    }
}

/* The text with the change; heap. */
static char *apply(const char *text, const struct change *change)
{
    char *changed = NULL;
    return asprintf(&changed, "%.*s%s%s", (int)change->from, text, change->text,
                    text + change->to) < 0
               ? NULL
               : changed;
}

static int edit_text(char **text, const struct settings_edit *edit, struct nacre_error *error)
{
    yaml_parser_t parser;
    yaml_document_t document;
    struct change change = {0};
    if (!yaml_parser_initialize(&parser)) {
        return nacre_fail_memory(error, "a settings file");
    }
    yaml_parser_set_input_string(&parser, (const unsigned char *)*text, strlen(*text));
    int status = NACRE_FAILED;
    if (!yaml_parser_load(&parser, &document)) {
        (void)nacre_fail(error, "line %zu: %s", parser.problem_mark.line + 1,
                         parser.problem ? parser.problem : "cannot be read");
    } else {
        status = find_change(&document, *text, edit, &change, error);
        yaml_document_delete(&document);
    }
    yaml_parser_delete(&parser);
    if (status == NACRE_OK) {
        char *changed = apply(*text, &change);
        status = changed ? NACRE_OK : nacre_fail_memory(error, "a settings file");
        free(*text);
        *text = changed;
    }
    return status;
}

/* What was made must be read with these values. */
static int check(const char *path, const char *text, const struct settings_schema *schema,
                 struct nacre_error *error)
{
    char *copy = strdup(path);
    void *settings = calloc(1, schema->size);
    int status = copy && settings ? NACRE_OK : nacre_fail_memory(error, path);
    if (status == NACRE_OK) {
        status = settings_parse(path, dirname(copy), text, strlen(text), schema, settings, error);
    }
    if (status == NACRE_OK) {
        settings_finish(schema, settings);
    }
    free(settings);
    free(copy);
    return status;
}

/* The new file's owner and permissions are the old one's: whoever read it reads it still. */
static int replace(const char *path, const char *text, struct nacre_error *error)
{
    struct whole_file file = {0};
    struct stat old;
    int status = whole_file_create(&file, path, error);
    if (status != NACRE_OK) {
        goto out;
    }
    FILE *stream = fopen(file.temporary, "we");
    bool written = stream && fputs(text, stream) >= 0;
    int number = written ? 0 : errno;
    if (stream && fclose(stream) != 0 && written) {
        number = errno;
    }
    if (number == 0 && (stat(path, &old) != 0 || chmod(file.temporary, old.st_mode & 07777) != 0)) {
        number = errno;
    }
    if (number != 0) {
        status = nacre_fail_errno(error, number, "cannot write %s", path);
        goto out;
    }
    (void)!chown(file.temporary, old.st_uid, old.st_gid); /* only root may, and others own it */
    status = whole_file_commit(&file, error);
out:
    whole_file_discard(&file);
    return status;
}

int settings_edit(const char *path, const struct settings_schema *schema,
                  const struct settings_edit *edits, size_t count, struct nacre_error *error)
{
    char *text = NULL;
    int status = read_text(path, &text, error);
    for (size_t i = 0; i < count && status == NACRE_OK && text; i++) {
        status = edit_text(&text, &edits[i], error);
        if (status != NACRE_OK) {
            (void)nacre_fail_within(error, "%s", path);
        }
    }
    if (status == NACRE_OK && text) {
        status = check(path, text, schema, error);
    }
    if (status == NACRE_OK && text) {
        status = replace(path, text, error);
    }
    free(text);
    return status;
}
