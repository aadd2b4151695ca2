/* What every verb does with bad input: one message that names the object, the right exit status, nothing on standard
 * output, no file left or altered. */
#include "tests/cmd/made.h"
#include "tests/cmd/mounts.h"
#include "tests/cmd/spawn.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <unity.h>

static const char *nacre;  /* the program */
static char *folder;       /* of this test case */
static char *inputs;       /* of all of them: scan.exr, material.exr, good YAML files */
static const char *shared; /* the repository's root, for the example files */

void setUp(void)
{
    folder = folder_make();
}

void tearDown(void)
{
    folder_remove(folder);
    folder = NULL;
}

static char *input(const char *name)
{
    return path_join(inputs, name);
}

static size_t count_lines(const char *text)
{
    size_t lines = 0;
    for (; *text; text++) {
        lines += *text == '\n';
    }
    return lines;
}

/* The verb with these arguments must fail with `status` and a message that holds `named`, and leave `folder` as it is.
 * A wrong usage is followed by a second line that names --help. */
static void refuses_under(const struct circumstances *around, int status, const char *named,
                          const char *const *arguments)
{
    char *before = folder_describe(folder);
    struct spawned run = spawn(arguments, around);
    char *after = folder_describe(folder);
    TEST_ASSERT_EQUAL_INT_MESSAGE(status, run.status, run.errors);
    TEST_ASSERT_EQUAL_INT_MESSAGE(status == 2 ? 2 : 1, count_lines(run.errors), run.errors);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(run.errors, named), run.errors);
    TEST_ASSERT_EQUAL_STRING("", run.output);
    TEST_ASSERT_EQUAL_STRING(before, after);
    spawned_finish(&run);
    free(before);
    free(after);
}

#define REFUSES(status, named, ...)                                                                \
    refuses_under(NULL, status, named, (const char *const[]){nacre, __VA_ARGS__, NULL})
#define REFUSES_UNDER(around, status, named, ...)                                                  \
    refuses_under(around, status, named, (const char *const[]){nacre, __VA_ARGS__, NULL})
