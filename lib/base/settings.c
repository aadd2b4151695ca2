/* Reading YAML settings by a schema: files, documents, mappings and lists of mappings. */
#include "base/settings.h"

#include "base/nearest.h"
#include "base/settings_value.h"

#include <errno.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { LARGEST_FILE = 16 << 20, DEEPEST = 32, MOST_VALUES = 1 << 18 };

static void *at(void *base, size_t offset)
{
    return (char *)base + offset;
}

/* The members of one struct that the fields put on the heap. */
static void finish_fields(const struct settings_schema *schema, void *settings)
{
    for (const struct settings_field *field = schema->fields; field->key; field++) {
        char **text = at(settings, field->offset);
        size_t length = 0;
        switch (field->kind) {
        case SETTINGS_STRING:
        case SETTINGS_PATH:
            free(*text);
            break;
        case SETTINGS_STRUCT:
            finish_fields(field->schema, at(settings, field->offset));
            break;
        case SETTINGS_LIST:
            length = *(size_t *)at(settings, field->length_offset);
            for (size_t i = 0; i < length; i++) {
                finish_fields(field->schema, *text + i * field->schema->size);
            }
            free(*text);
            break;
        case SETTINGS_NUMBERS:
            free(*text);
            break;
        case SETTINGS_STRINGS:
            length = *(size_t *)at(settings, field->length_offset);
            for (size_t i = 0; i < length; i++) {
                free((*(char ***)(void *)text)[i]);
            }
            free(*text);
            break;
        default:
            break;
        }
    }
}

void settings_finish(const struct settings_schema *schema, void *settings)
{
    finish_fields(schema, settings);
    memset(settings, 0, schema->size);
}

static int fail_from_parser(const struct settings_source *source, const yaml_parser_t *parser,
                            struct nacre_error *error)
{
    const char *problem = parser->problem ? parser->problem : "not YAML";
    if (parser->error == YAML_MEMORY_ERROR) {
        return nacre_fail_memory(error, source->name);
    }
    if (parser->error == YAML_READER_ERROR) {
        return nacre_fail(error, "%s: not a YAML file: byte %zu: %s", source->name,
                          parser->problem_offset, problem);
    }
    return settings_fail_at(source, parser->problem_mark, error, "%s%s%s",
                            parser->context ? parser->context : "", parser->context ? ": " : "",
                            problem);
}

static int refuse_event(const struct settings_source *source, const yaml_event_t *event,
                        struct nacre_error *error)
{
    const yaml_char_t *anchor = NULL, *tag = NULL;
    if (event->type == YAML_ALIAS_EVENT) {
        anchor = event->data.alias.anchor;
    } else if (event->type == YAML_SCALAR_EVENT) {
        anchor = event->data.scalar.anchor;
        tag = event->data.scalar.tag;
    } else if (event->type == YAML_SEQUENCE_START_EVENT) {
        anchor = event->data.sequence_start.anchor;
        tag = event->data.sequence_start.tag;
    } else if (event->type == YAML_MAPPING_START_EVENT) {
        anchor = event->data.mapping_start.anchor;
        tag = event->data.mapping_start.tag;
    }
    if (anchor) {
        return settings_fail_at(source, event->start_mark, error,
                                "anchors and aliases ('%s') are not read here; write the value out",
                                (const char *)anchor);
    }
    if (tag) {
        return settings_fail_at(source, event->start_mark, error,
                                "tags ('%s') are not read here; leave it out", (const char *)tag);
    }
    return NACRE_OK;
}

/* Look through the whole text for what no settings file may hold, before anything is built from it.
 */
static int refuse_strange_yaml(const struct settings_source *source, const char *text, size_t size,
                               struct nacre_error *error)
{
    yaml_parser_t parser;
    bool done = false;
    int result = NACRE_OK, depth = 0, documents = 0, values = 0;
    if (!yaml_parser_initialize(&parser)) {
        return nacre_fail_memory(error, source->name);
    }
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    while (result == NACRE_OK && !done) {
        yaml_event_t event;
        if (!yaml_parser_parse(&parser, &event)) {
            result = fail_from_parser(source, &parser, error);
            break;
        }
        done = event.type == YAML_STREAM_END_EVENT;
        documents += event.type == YAML_DOCUMENT_START_EVENT;
        depth += event.type == YAML_MAPPING_START_EVENT || event.type == YAML_SEQUENCE_START_EVENT;
        values += event.type == YAML_MAPPING_START_EVENT ||
                  event.type == YAML_SEQUENCE_START_EVENT || event.type == YAML_SCALAR_EVENT;
        depth -= event.type == YAML_MAPPING_END_EVENT || event.type == YAML_SEQUENCE_END_EVENT;
        result = refuse_event(source, &event, error);
        if (result == NACRE_OK && depth > DEEPEST) {
            result = settings_fail_at(source, event.start_mark, error,
                                      "nested more than %d levels deep", DEEPEST);
        }
        if (result == NACRE_OK && values > MOST_VALUES) {
            result = settings_fail_at(source, event.start_mark, error,
                                      "more than %d keys and values, which no settings have",
                                      MOST_VALUES);
        }
        if (result == NACRE_OK && documents > 1) {
            result = settings_fail_at(source, event.start_mark, error,
                                      "a second document begins; one file holds one");
        }
        yaml_event_delete(&event);
    }
    yaml_parser_delete(&parser);
    return result;
}

/* Load the one document of `text`; the caller deletes it on success. */
static int load_document(const struct settings_source *source, const char *text, size_t size,
                         yaml_document_t *document, struct nacre_error *error)
{
    yaml_parser_t parser;
    int result = NACRE_OK;
    if (!yaml_parser_initialize(&parser)) {
        return nacre_fail_memory(error, source->name);
    }
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    if (!yaml_parser_load(&parser, document)) {
        result = fail_from_parser(source, &parser, error);
    }
    yaml_parser_delete(&parser);
    return result;
}

/* Set a field from its fallback, which is a small YAML document of its own. */
static int apply_fallback(const struct settings_source *source, const struct settings_field *field,
                          void *out, struct nacre_error *error)
{
    yaml_document_t document;
    struct settings_source own = {.name = source->name, .folder = source->folder};
    if (load_document(&own, field->fallback, strlen(field->fallback), &document, error) !=
        NACRE_OK) {
        return nacre_fail_within(error, "the default of '%s'", field->key);
    }
    own.document = &document;
    const yaml_node_t *root = yaml_document_get_root_node(&document);
    int result = root ? settings_set_value(&own, field, root, out, error)
                      : nacre_fail(error, "%s: empty", field->key);
    yaml_document_delete(&document);
    return result == NACRE_OK ? NACRE_OK
                              : nacre_fail_within(error, "the default of '%s'", field->key);
}

int settings_apply_defaults(const struct settings_source *source,
                            const struct settings_schema *schema, void *out,
                            struct nacre_error *error)
{
    for (const struct settings_field *field = schema->fields; field->key; field++) {
        int result = NACRE_OK;
        if (field->kind == SETTINGS_STRUCT) {
            result = settings_apply_defaults(source, field->schema, at(out, field->offset), error);
        } else if (field->fallback) {
            result = apply_fallback(source, field, out, error);
        }
        if (result != NACRE_OK) {
            return result;
        }
    }
    return NACRE_OK;
}

/* ", perhaps 'softness'; known here: softness, depth". */
static void describe_keys(const struct settings_schema *schema, const char *typed, char *text,
                          size_t size)
{
    struct nearest nearest = nearest_begin(typed);
    size_t used = 0;
    for (const struct settings_field *field = schema->fields; field->key; field++) {
        nearest_offer(&nearest, field->key);
    }
    if (nearest.best) {
        used += (size_t)snprintf(text, size, ", perhaps '%s'", nearest.best);
    }
    for (const struct settings_field *field = schema->fields; field->key && used < size; field++) {
        used += (size_t)snprintf(text + used, size - used, "%s%s",
                                 field == schema->fields ? "; known here: " : ", ", field->key);
    }
}

/* The field that a key node names, or NULL with the error set. */
static const struct settings_field *find_field(const struct settings_source *source,
                                               const struct settings_schema *schema,
                                               const yaml_node_t *key, struct nacre_error *error)
{
    char known[700] = "";
    if (key->type != YAML_SCALAR_NODE) {
        (void)settings_fail_at(source, key->start_mark, error, "a key must be a plain word");
        return NULL;
    }
    const char *typed = (const char *)key->data.scalar.value;
    for (const struct settings_field *field = schema->fields; field->key; field++) {
        if (strcmp(field->key, typed) == 0 && key->data.scalar.length == strlen(typed)) {
            return field;
        }
    }
    describe_keys(schema, typed, known, sizeof known);
    (void)settings_fail_at(source, key->start_mark, error, "unknown key '%.80s'%s", typed, known);
    return NULL;
}

static int read_mapping(const struct settings_source *source, const struct settings_schema *schema,
                        const char *name, const yaml_node_t *node, void *out,
                        struct nacre_error *error);

/* A mapping below a key. */
static int read_named(const struct settings_source *source, const struct settings_field *field,
                      const yaml_node_t *node, void *out, struct nacre_error *error)
{
    char name[80];
    (void)snprintf(name, sizeof name, "'%s'", field->key);
    return read_mapping(source, field->schema, name, node, out, error);
}

static int read_list(const struct settings_source *source, const struct settings_field *field,
                     const yaml_node_t *node, void *out, struct nacre_error *error)
{
    if (node->type != YAML_SEQUENCE_NODE) {
        return settings_fail_at(source, node->start_mark, error,
                                "'%s' takes a sequence of mappings, each after a dash", field->key);
    }
    size_t count = (size_t)(node->data.sequence.items.top - node->data.sequence.items.start);
    char *items = calloc(count ? count : 1, field->schema->size);
    if (!items) {
        return nacre_fail_memory(error, source->name);
    }
    *(char **)at(out, field->offset) = items;
    *(size_t *)at(out, field->length_offset) = count;
    for (size_t i = 0; i < count; i++) {
        const yaml_node_t *item =
            yaml_document_get_node(source->document, node->data.sequence.items.start[i]);
        void *place = items + i * field->schema->size;
        if (settings_apply_defaults(source, field->schema, place, error) != NACRE_OK ||
            read_named(source, field, item, place, error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return NACRE_OK;
}

/* A value that comes in place of a default: free the default's memory first. */
static void drop_default(const struct settings_field *field, void *out)
{
    const struct settings_field fields[] = {*field, {0}};
    const struct settings_schema alone = {.fields = fields};
    if (field->kind == SETTINGS_STRING || field->kind == SETTINGS_PATH ||
        field->kind == SETTINGS_NUMBERS || field->kind == SETTINGS_STRINGS) {
        finish_fields(&alone, out);
        *(char **)at(out, field->offset) = NULL;
    }
    if (field->kind == SETTINGS_NUMBERS || field->kind == SETTINGS_STRINGS) {
        *(size_t *)at(out, field->length_offset) = 0;
    }
}

/* Where something stands in the file, counted from 1. */
static void note_place(const yaml_mark_t *mark, size_t line_offset, size_t column_offset, void *out)
{
    if (line_offset) {
        *(int *)at(out, line_offset) = (int)mark->line + 1;
    }
    if (column_offset) {
        *(int *)at(out, column_offset) = (int)mark->column + 1;
    }
}

static int read_field(const struct settings_source *source, const struct settings_field *field,
                      const yaml_node_t *key, const yaml_node_t *value, void *out,
                      struct nacre_error *error)
{
    note_place(&key->start_mark, field->line_offset, field->column_offset, out);
    if (field->kind == SETTINGS_STRUCT) {
        return read_named(source, field, value, at(out, field->offset), error);
    }
    if (field->kind == SETTINGS_LIST) {
        return read_list(source, field, value, out, error);
    }
    drop_default(field, out);
    return settings_set_value(source, field, value, out, error);
}

static const yaml_node_t *pair_key(const struct settings_source *source,
                                   const yaml_node_pair_t *pair)
{
    return yaml_document_get_node(source->document, pair->key);
}

/* The line of an earlier pair with the same key as `pair`, or 0. */
static size_t find_duplicate(const struct settings_source *source, const yaml_node_t *node,
                             const yaml_node_pair_t *pair)
{
    const yaml_node_t *key = pair_key(source, pair);
    for (const yaml_node_pair_t *other = node->data.mapping.pairs.start; other < pair; other++) {
        const yaml_node_t *earlier = pair_key(source, other);
        if (strcmp((const char *)earlier->data.scalar.value,
                   (const char *)key->data.scalar.value) == 0) {
            return earlier->start_mark.line + 1;
        }
    }
    return 0;
}

static bool has_key(const struct settings_source *source, const yaml_node_t *node, const char *key)
{
    for (const yaml_node_pair_t *pair = node->data.mapping.pairs.start;
         pair < node->data.mapping.pairs.top; pair++) {
        if (strcmp((const char *)pair_key(source, pair)->data.scalar.value, key) == 0) {
            return true;
        }
    }
    return false;
}

static int check_required(const struct settings_source *source,
                          const struct settings_schema *schema, const char *name,
                          const yaml_node_t *node, struct nacre_error *error)
{
    for (const struct settings_field *field = schema->fields; field->key; field++) {
        if (field->required && !has_key(source, node, field->key)) {
            return settings_fail_at(source, node->start_mark, error, "%s lacks the key '%s'%s%s%s",
                                    name, field->key, field->sentence ? " (" : "",
                                    field->sentence ? field->sentence : "",
                                    field->sentence ? ")" : "");
        }
    }
    return NACRE_OK;
}

/* Read a mapping over the defaults that `out` holds; `name` is how messages call it. */
static int read_mapping(const struct settings_source *source, const struct settings_schema *schema,
                        const char *name, const yaml_node_t *node, void *out,
                        struct nacre_error *error)
{
    if (node->type != YAML_MAPPING_NODE) {
        char known[700] = "";
        describe_keys(schema, "", known, sizeof known);
        return settings_fail_at(source, node->start_mark, error, "%s takes 'key: value' lines%s",
                                name, known);
    }
    note_place(&node->start_mark, schema->line_offset, schema->column_offset, out);
    for (const yaml_node_pair_t *pair = node->data.mapping.pairs.start;
         pair < node->data.mapping.pairs.top; pair++) {
        const yaml_node_t *key = pair_key(source, pair);
        const struct settings_field *field = find_field(source, schema, key, error);
        if (!field) {
            return NACRE_FAILED;
        }
        size_t earlier = find_duplicate(source, node, pair);
        if (earlier) {
            return settings_fail_at(source, key->start_mark, error,
                                    "'%s' is given twice; first in line %zu", field->key, earlier);
        }
        const yaml_node_t *value = yaml_document_get_node(source->document, pair->value);
        if (read_field(source, field, key, value, out, error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    return check_required(source, schema, name, node, error);
}

int settings_parse(const char *name, const char *folder, const char *text, size_t size,
                   const struct settings_schema *schema, void *out, struct nacre_error *error)
{
    char root_name[64];
    yaml_document_t document;
    struct settings_source source = {.name = name, .folder = folder, .document = &document};
    memset(out, 0, schema->size);
    if (refuse_strange_yaml(&source, text, size, error) != NACRE_OK ||
        load_document(&source, text, size, &document, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    const yaml_node_t *root = yaml_document_get_root_node(&document);
    int result = NACRE_FAILED;
    if (!root) {
        (void)nacre_fail(error, "%s: empty, but should be a %s", name, schema->what);
    } else if (settings_apply_defaults(&source, schema, out, error) == NACRE_OK) {
        (void)snprintf(root_name, sizeof root_name, "the %s", schema->what);
        result = read_mapping(&source, schema, root_name, root, out, error);
    }
    if (result != NACRE_OK) {
        settings_finish(schema, out);
    }
    yaml_document_delete(&document);
    return result;
}

/* The whole file on the heap. */
static char *read_text(const char *path, size_t *size, struct nacre_error *error)
{
    struct stat status;
    char *text = NULL;
    FILE *file = fopen(path, "re");
    if (!file || fstat(fileno(file), &status) != 0 || S_ISDIR(status.st_mode)) {
        (void)nacre_fail_errno(error, file ? EISDIR : errno, "%s: cannot be read", path);
        goto out;
    }
    text = malloc(LARGEST_FILE + 1);
    if (!text) {
        (void)nacre_fail_memory(error, path);
        goto out;
    }
    *size = fread(text, 1, LARGEST_FILE + 1, file);
    if (ferror(file)) {
        (void)nacre_fail_errno(error, errno, "%s: cannot be read", path);
        free(text);
        text = NULL;
    } else if (*size > LARGEST_FILE) {
        (void)nacre_fail(error, "%s: larger than 16 MiB, which no settings are", path);
        free(text);
        text = NULL;
    }
out:
    if (file) {
        (void)fclose(file);
    }
    return text;
}

int settings_read(const char *path, const struct settings_schema *schema, void *out,
                  struct nacre_error *error)
{
    size_t size = 0;
    int result = NACRE_FAILED;
    char *text = NULL;
    const char *slash = strrchr(path, '/');
    char *folder = slash ? strndup(path, slash == path ? 1 : (size_t)(slash - path)) : strdup(".");
    char *whole = folder ? realpath(folder, NULL) : NULL;
    memset(out, 0, schema->size);
    text = folder ? read_text(path, &size, error) : NULL;
    if (!folder) {
        (void)nacre_fail_memory(error, path);
    } else if (text) {
        result = settings_parse(path, whole ? whole : folder, text, size, schema, out, error);
    }
    free(text);
    free(whole);
    free(folder);
    return result;
}
