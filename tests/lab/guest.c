/* Help for test programs in the lab's guest. */
#include "guest.h"

#include "unity.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

void guest_require(void)
{
    if (!getenv("LAB_KERNEL")) {
        (void)fputs("this test changes the machine it runs on: run it by tests/lab/lab.py\n",
                    stderr);
        exit(2);
    }
}

void guest_run(const char *format, ...)
{
    char line[512];
    va_list arguments;
    va_start(arguments, format);
    /* NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized): it is initialized */
    (void)vsnprintf(line, sizeof line, format, arguments);
    va_end(arguments);
    /* NOLINTNEXTLINE(cert-env33-c): a shell is what is wanted */
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, system(line), line);
}

void guest_write(const char *path, const char *text)
{
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL_MESSAGE(file, path);
    bool good = fputs(text, file) >= 0;
    good = fclose(file) == 0 && good;
    TEST_ASSERT_TRUE_MESSAGE(good, path);
}

const char *guest_read(const char *path)
{
    static char lines[8][128];
    static int next;
    char *line = lines[next++ % 8];
    FILE *file = fopen(path, "r");
    TEST_ASSERT_NOT_NULL_MESSAGE(file, path);
    bool good = fgets(line, sizeof lines[0], file) != NULL;
    (void)fclose(file);
    TEST_ASSERT_TRUE_MESSAGE(good, path);
    line[strcspn(line, "\n")] = '\0';
    return line;
}

void guest_wait_for(const char *path, bool there)
{
    for (int i = 0; i < 500 && (access(path, F_OK) == 0) != there; i++) {
        (void)usleep(10000);
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(there, access(path, F_OK) == 0, path);
}
