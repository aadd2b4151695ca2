/* What the documentation says of the command line is true: every verb and option that README.md and docs/ name in code
 * exists, every verb is explained, and links lead somewhere. */
#include "tests/cmd/spawn.h"

#include <ctype.h>
#include <dirent.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <unity.h>

void setUp(void)
{
}

void tearDown(void)
{
}

/* Call `check` with every piece of code of a Markdown file: lines of ``` blocks, and what stands between backticks. */
static void for_code(const char *path, void (*check)(const char *where, const char *code))
{
    size_t size = 0;
    char *text = (char *)file_read(path, &size);
    bool in_block = false;
    int number = 0;
    char *rest = text;
    TEST_ASSERT_NOT_NULL_MESSAGE(text, path);
    for (char *line = strsep(&rest, "\n"); line; line = strsep(&rest, "\n")) {
        char where[512];
        (void)snprintf(where, sizeof where, "%s:%d", path, ++number);
        if (strncmp(line, "```", 3) == 0) {
            in_block = !in_block;
        } else if (in_block) {
            check(where, line);
        } else {
            char *spans = line;
            (void)strsep(&spans, "`");
            while (spans) {
                const char *code = strsep(&spans, "`");
                check(where, code);
                (void)(spans ? strsep(&spans, "`") : NULL);
            }
        }
    }
    free(text);
}

static int is_markdown(const struct dirent *entry)
{
    const char *end = strrchr(entry->d_name, '.');
    return end && strcmp(end, ".md") == 0;
}

static void for_all_files(void (*visit)(const char *path))
{
    char *folder = path_join(SOURCES, "docs");
    char *readme = path_join(SOURCES, "README.md");
    struct dirent **entries = NULL;
    int count = scandir(folder, &entries, is_markdown, alphasort);
    TEST_ASSERT_TRUE_MESSAGE(count > 0, folder);
    for (int i = 0; i < count; i++) {
        char *path = path_join(folder, entries[i]->d_name);
        visit(path);
        free(path);
        free(entries[i]);
    }
    free(entries);
    visit(readme);
    free(readme);
    free(folder);
}

/* The help of a verb, heap; NULL when there is no such verb. */
static char *help_of(const char *verb)
{
    const char *const arguments[] = {NACRE, verb, "--help", NULL};
    struct spawned run = spawn(arguments, NULL);
    char *text = run.status == 0 ? strdup(run.output) : NULL;
    spawned_finish(&run);
    return text;
}

/* Whether `text` holds `option` ("--terms"), not only a longer one that begins so. */
static bool names_option(const char *text, const char *option, size_t length)
{
    for (const char *found = text; (found = memmem(found, strlen(found), option, length));
         found++) {
        if (!isalnum((unsigned char)found[length]) && found[length] != '-') {
            return true;
        }
    }
    return false;
}

static void check_options(const char *where, const char *verb, const char *help, const char *code)
{
    for (const char *option = strstr(code, " --"); option; option = strstr(option, " --")) {
        char message[600];
        option++;
        size_t length = 2 + strspn(option + 2, "abcdefghijklmnopqrstuvwxyz0123456789-");
        (void)snprintf(message, sizeof message, "%s: %s has no option %.*s", where, verb,
                       (int)length, option);
        TEST_ASSERT_TRUE_MESSAGE(names_option(help, option, length), message);
    }
}

static int commands_checked;

/* Code such as "build/cmd/nacre factor scan.exr -o material.exr --terms 5". */
static void check_command(const char *where, const char *code)
{
    char verb[32] = "";
    char message[600];
    const char *program = strstr(code, "nacre ");
    if (!program || (program > code && !strchr("/ [", program[-1])) ||
        sscanf(program, "nacre %31[a-z]", verb) != 1) {
        return;
    }
    char *help = help_of(verb);
    (void)snprintf(message, sizeof message, "%s: there is no verb %s", where, verb);
    TEST_ASSERT_NOT_NULL_MESSAGE(help, message);
    check_options(where, verb, help, program);
    commands_checked++;
    free(help);
}

static void check_commands(const char *path)
{
    for_code(path, check_command);
}

static void verbs_and_options_in_the_documentation_exist(void)
{
    for_all_files(check_commands);
    TEST_ASSERT_TRUE_MESSAGE(commands_checked >= 8, "the documentation shows hardly any command");
}

/* A link's target, as it stands behind "](", relative to the file that it is in. */
static void check_links(const char *path)
{
    size_t size = 0;
    char *text = (char *)file_read(path, &size);
    int folder = (int)(strrchr(path, '/') - path);
    TEST_ASSERT_NOT_NULL_MESSAGE(text, path);
    for (char *link = strstr(text, "]("); link; link = strstr(link + 1, "](")) {
        char target[600];
        int length = (int)strcspn(link + 2, ")#");
        (void)snprintf(target, sizeof target, "%.*s/%.*s", folder, path, length, link + 2);
        if (length > 0 && strncmp(link + 2, "http", 4) != 0) {
            TEST_ASSERT_EQUAL_INT_MESSAGE(0, access(target, F_OK), target);
        }
    }
    free(text);
}

static void links_in_the_documentation_lead_somewhere(void)
{
    for_all_files(check_links);
}

/* `nacre --help` lists verbs as "  NAME  summary"; README's table of verbs has a row for each. */
static void every_verb_is_in_the_readme(void)
{
    const char *const arguments[] = {NACRE, "--help", NULL};
    struct spawned run = spawn(arguments, NULL);
    char *path = path_join(SOURCES, "README.md");
    size_t size = 0;
    char *readme = (char *)file_read(path, &size);
    char *rest = run.output;
    int verbs = 0;
    TEST_ASSERT_NOT_NULL(readme);
    for (char *line = strsep(&rest, "\n"); line; line = strsep(&rest, "\n")) {
        char verb[32];
        char row[64];
        if (line[0] == ' ' && line[1] == ' ' && islower((unsigned char)line[2]) &&
            sscanf(line, " %31[a-z]", verb) == 1 && strcmp(verb, "help") != 0) {
            (void)snprintf(row, sizeof row, "| `nacre %s", verb);
            TEST_ASSERT_NOT_NULL_MESSAGE(strstr(readme, row), row);
            verbs++;
        }
    }
    TEST_ASSERT_TRUE(verbs >= 8);
    free(readme);
    free(path);
    spawned_finish(&run);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(verbs_and_options_in_the_documentation_exist);
    RUN_TEST(links_in_the_documentation_lead_somewhere);
    RUN_TEST(every_verb_is_in_the_readme);
    return UNITY_END();
}
