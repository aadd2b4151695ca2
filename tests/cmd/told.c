/* What programs told on standard output. */
#include "tests/cmd/told.h"

#include "tests/cmd/spawn.h"

#include <stdio.h>
#include <string.h>
#include <unity.h>

char *told_well(const char *const *arguments)
{
    struct spawned run = spawn(arguments, NULL);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, run.status, run.errors);
    TEST_ASSERT_EQUAL_STRING("", run.errors);
    char *output = strdup(run.output);
    TEST_ASSERT_NOT_NULL(output);
    spawned_finish(&run);
    return output;
}

json_t *told_parse(const char *text)
{
    json_error_t why;
    json_t *root = json_loads(text, 0, &why);
    if (!root) {
        (void)printf("%s\n%s\n", why.text, text);
    }
    TEST_ASSERT_NOT_NULL_MESSAGE(root, "what was told is no JSON");
    return root;
}

static const json_t *find(const json_t *told, const char *path)
{
    const char *rest = path;
    for (const char *dot = strchr(rest, '.'); dot; dot = strchr(rest, '.')) {
        char group[64];
        (void)snprintf(group, sizeof group, "%.*s", (int)(dot - rest), rest);
        told = json_object_get(told, group);
        rest = dot + 1;
    }
    return json_object_get(told, rest);
}

double told_number(const json_t *told, const char *path)
{
    const json_t *value = find(told, path);
    TEST_ASSERT_TRUE_MESSAGE(json_is_number(value), path);
    return json_number_value(value);
}

int told_count(const char *text, const char *path)
{
    json_t *told = told_parse(text);
    const json_t *value = find(told, path);
    TEST_ASSERT_TRUE_MESSAGE(json_is_integer(value), path);
    int count = (int)json_integer_value(value);
    json_decref(told);
    return count;
}
