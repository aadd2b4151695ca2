/* Files and folders of tests. */
#include "tests/files.h"

#include <dirent.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* A test that cannot set itself up must not go on. */
static void demand(bool held, const char *what)
{
    if (!held) {
        perror(what);
        abort();
    }
}

char *path_join(const char *folder, const char *name)
{
    char *path = NULL;
    demand(asprintf(&path, "%s/%s", folder, name) >= 0, "asprintf");
    return path;
}

char *folder_make(void)
{
    const char *base = getenv("TMPDIR");
    char *folder = path_join(base && *base ? base : "/tmp", "nacre-test-XXXXXX");
    demand(mkdtemp(folder) != NULL, folder);
    return folder;
}

static int keep_real(const struct dirent *entry)
{
    return strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0;
}

/* Call `visit` for everything below `folder`, in order, children before their folder. */
static void walk(const char *folder, void (*visit)(const char *path, const struct stat *, void *),
                 void *context)
{
    struct dirent **entries = NULL;
    int count = scandir(folder, &entries, keep_real, alphasort);
    for (int i = 0; i < count; i++) {
        struct stat status;
        char *path = path_join(folder, entries[i]->d_name);
        if (lstat(path, &status) == 0) {
            if (S_ISDIR(status.st_mode)) {
                walk(path, visit, context);
            }
            visit(path, &status, context);
        }
        free(path);
        free(entries[i]);
    }
    free(entries);
}

static void remove_entry(const char *path, const struct stat *status, void *context)
{
    (void)status;
    (void)context;
    (void)remove(path); /* what stays is seen by the rmdir of the whole */
}

void folder_remove(char *folder)
{
    if (folder) {
        walk(folder, remove_entry, NULL);
        demand(rmdir(folder) == 0, folder);
        free(folder);
    }
}

static void describe_entry(const char *path, const struct stat *status, void *context)
{
    FILE *text = context;
    uint64_t hash = 14695981039346656037U; /* FNV-1a */
    if (S_ISREG(status->st_mode)) {
        size_t size = 0;
        uint8_t *bytes = file_read(path, &size);
        for (size_t i = 0; bytes && i < size; i++) {
            hash = (hash ^ bytes[i]) * 1099511628211U;
        }
        free(bytes);
    }
    (void)fprintf(text, "%s %ld %016llx\n", path,
                  S_ISREG(status->st_mode) ? (long)status->st_size : -1L, (unsigned long long)hash);
}

char *folder_describe(const char *folder)
{
    char *text = NULL;
    size_t size = 0;
    FILE *memory = open_memstream(&text, &size);
    demand(memory != NULL, "open_memstream");
    walk(folder, describe_entry, memory);
    (void)fclose(memory);
    return text;
}

uint8_t *file_read(const char *path, size_t *size)
{
    uint8_t *bytes = NULL;
    FILE *file = fopen(path, "re");
    *size = 0;
    if (file) {
        struct stat status;
        demand(fstat(fileno(file), &status) == 0, path);
        bytes = calloc(1, (size_t)status.st_size + 1);
        demand(bytes != NULL, path);
        *size = fread(bytes, 1, (size_t)status.st_size, file);
        (void)fclose(file);
    }
    return bytes;
}

void file_write(const char *path, const void *bytes, size_t size)
{
    FILE *file = fopen(path, "we");
    demand(file != NULL, path);
    demand(fwrite(bytes, 1, size, file) == size, path);
    demand(fclose(file) == 0, path);
}

void text_write(const char *path, const char *text)
{
    file_write(path, text, strlen(text));
}
