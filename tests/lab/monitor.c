/* QEMU's monitor on a serial port. */
#include "monitor.h"

#include "guest.h"
#include "unity.h"

#include <fcntl.h>
#include <glob.h>
#include <poll.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static int open_port(void)
{
    char path[64] = "";
    glob_t names;
    TEST_ASSERT_EQUAL_INT(0, glob("/sys/class/virtio-ports/*/name", 0, NULL, &names));
    for (size_t i = 0; i < names.gl_pathc; i++) {
        if (strcmp(guest_read(names.gl_pathv[i]), "lab.monitor") == 0) {
            const char *port = names.gl_pathv[i] + strlen("/sys/class/virtio-ports/");
            (void)snprintf(path, sizeof path, "/dev/%.*s", (int)strcspn(port, "/"), port);
        }
    }
    globfree(&names);
    int file = open(path, O_RDWR | O_CLOEXEC);
    TEST_ASSERT_TRUE_MESSAGE(file >= 0, path);
    return file;
}

/* Read until the words come; whether they did within half a minute. */
static bool read_until(int file, const char *words)
{
    char text[8192];
    size_t used = 0;
    struct pollfd wanted = {.fd = file, .events = POLLIN};
    while (poll(&wanted, 1, 30000) > 0) {
        /* Only the end matters. */
        if (used > sizeof text / 2) {
            memmove(text, text + used - 64, 64);
            used = 64;
        }
        ssize_t size = read(file, text + used, sizeof text - 1 - used);
        if (size <= 0) {
            return false;
        }
        used += (size_t)size;
        text[used] = '\0';
        if (strstr(text, words)) {
            return true;
        }
    }
    return false;
}

void monitor_do(const char *format, ...)
{
    static int count = 10000;
    char command[512];
    char sum[16];
    va_list arguments;
    va_start(arguments, format);
    /* NOLINTNEXTLINE(clang-analyzer-valist.Uninitialized): it is initialized */
    int length = vsnprintf(command, sizeof command, format, arguments);
    va_end(arguments);
    TEST_ASSERT_TRUE(length > 0 && length < (int)sizeof command);
    /* The monitor repeats what it is told, but adds only when it has come to it. */
    (void)snprintf(sum, sizeof sum, "%d", 70000 + ++count);
    int file = open_port();
    TEST_ASSERT_TRUE(dprintf(file, "%s\nprint/d 70000+%d\n", command, count) > length);
    bool done = read_until(file, sum);
    (void)close(file);
    TEST_ASSERT_TRUE_MESSAGE(done, command);
}

uint32_t *monitor_screen(int *width, int *height)
{
    static int count;
    char path[256];
    const char *folder = getenv("LAB_WORK");
    TEST_ASSERT_NOT_NULL(folder);
    /* A new name each time, as the guest remembers what files held. */
    (void)snprintf(path, sizeof path, "%s/screen%d.ppm", folder, count++);
    monitor_do("screendump %s", path);
    FILE *file = fopen(path, "rb");
    TEST_ASSERT_NOT_NULL_MESSAGE(file, path);
    char line[64];
    char *rest = NULL;
    TEST_ASSERT_EQUAL_STRING("P6\n", fgets(line, sizeof line, file));
    TEST_ASSERT_NOT_NULL(fgets(line, sizeof line, file));
    *width = (int)strtol(line, &rest, 10);
    *height = (int)strtol(rest, NULL, 10);
    TEST_ASSERT_EQUAL_STRING("255\n", fgets(line, sizeof line, file));
    size_t pixels = (size_t)*width * (size_t)*height;
    uint8_t *bytes = malloc(pixels * 3);
    uint32_t *screen = calloc(pixels, sizeof *screen);
    TEST_ASSERT_NOT_NULL(bytes);
    TEST_ASSERT_NOT_NULL(screen);
    TEST_ASSERT_EQUAL_INT(pixels * 3, fread(bytes, 1, pixels * 3, file));
    (void)fclose(file);
    for (size_t i = 0; i < pixels; i++) {
        screen[i] = (uint32_t)bytes[3 * i] << 16 | (uint32_t)bytes[3 * i + 1] << 8 |
                    (uint32_t)bytes[3 * i + 2];
    }
    free(bytes);
    return screen;
}
