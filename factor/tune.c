/* The memory of trials: a text file, a line a tile. */
#include "factor/tune.h"

#include "nacre/whole_file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define HEADING "nacre tiles 1\n"

/* Beyond that a file is not one of ours. */
enum { FILE_LIMIT = 1 << 20, KEY = 640 };

char *tune_path(void)
{
    const char *cache = getenv("CACHE_DIRECTORY"), *user = getenv("XDG_CACHE_HOME"),
               *home = getenv("HOME");
    char *path = NULL;
    int length = -1;
    if (cache && *cache == '/') { /* one folder, or several with colons between them */
        length = asprintf(&path, "%.*s/tiles.tsv", (int)strcspn(cache, ":"), cache);
    } else if (user && *user == '/') {
        length = asprintf(&path, "%s/nacre/tiles.tsv", user);
    } else if (home && *home == '/') {
        length = asprintf(&path, "%s/.cache/nacre/tiles.tsv", home);
    }
    return length < 0 ? NULL : path;
}

/* The beginning of all lines of a class: device, driver, method, lanes, clustered, half, with tabs behind each. */
static void make_key(const struct opencl *opencl, struct tune_class class, char key[KEY])
{
    char driver[256] = "";
    (void)clGetDeviceInfo(opencl->device, CL_DRIVER_VERSION, sizeof driver - 1, driver, NULL);
    int names = snprintf(key, KEY, "%s\n%s", opencl->name, driver);
    for (int i = 0; i < names && i < KEY; i++) {
        key[i] = key[i] == '\n' || key[i] == '\t' || key[i] == '\r' ? ' ' : key[i];
    }
    key[strlen(opencl->name)] = '\t';
    size_t used = strlen(key);
    (void)snprintf(key + used, KEY - used, "\t%s\t%d\t%d\t%d\t", class.method, class.lanes,
                   class.clustered, class.half);
}

/* The whole file, ended by a 0, or NULL where it is not there or not one of ours. */
static char *read_file(const char *path)
{
    FILE *file = path ? fopen(path, "re") : NULL;
    char *text = file ? calloc(FILE_LIMIT + 1, 1) : NULL;
    size_t size = text ? fread(text, 1, FILE_LIMIT, file) : 0;
    if (file) {
        (void)fclose(file);
    }
    if (size >= FILE_LIMIT || !text || strncmp(text, HEADING, strlen(HEADING)) != 0) {
        free(text);
        text = NULL;
    }
    return text;
}

/* The end of a line, or NULL for one that was cut off. */
static char *end_of(char *line)
{
    return strchr(line, '\n');
}

/* The numbers of a line, with tabs between them. */
static bool parse(const char *rest, struct tune_result *result)
{
    char *end = NULL;
    for (int i = 0; i < TUNE_NUMBERS; i++, rest = end + 1) {
        long number = strtol(rest, &end, 10);
        if (*end != '\t' || number < 1 || number > 64) {
            return false;
        }
        result->tile[i] = (int)number;
    }
    result->seconds = strtod(rest, &end);
    return end != rest && *end == '\0' && isfinite(result->seconds) && result->seconds > 0;
}

size_t tune_recall(const struct opencl *opencl, struct tune_class class,
                   struct tune_result *results)
{
    char key[KEY], *path = tune_path(), *text = read_file(path), *end = NULL;
    size_t count = 0;
    make_key(opencl, class, key);
    for (char *line = text; line && (end = end_of(line)) && count < TUNE_TILES; line = end + 1) {
        *end = '\0';
        if (strncmp(line, key, strlen(key)) == 0 && parse(line + strlen(key), &results[count])) {
            count++;
        }
    }
    free(text);
    free(path);
    return count;
}

/* Make the folders that the file is in; where that fails, writing tells. */
static void make_folders(char *path)
{
    for (char *slash = strchr(path + 1, '/'); slash; slash = strchr(slash + 1, '/')) {
        *slash = '\0';
        (void)mkdir(path, 0777);
        *slash = '/';
    }
}

/* All lines of `text` that are not the key's, then the results. */
static void print(FILE *to, char *text, const char *key, const struct tune_result *results,
                  size_t count)
{
    char *end = NULL;
    (void)fputs(HEADING, to);
    for (char *line = text ? text + strlen(HEADING) : NULL; line && (end = end_of(line));
         line = end + 1) {
        *end = '\0';
        if (strncmp(line, key, strlen(key)) != 0) {
            (void)fprintf(to, "%s\n", line);
        }
    }
    for (size_t i = 0; i < count; i++) {
        (void)fprintf(to, "%s%d\t%d\t%d\t%.4g\n", key, results[i].tile[0], results[i].tile[1],
                      results[i].tile[2], results[i].seconds);
    }
}

int tune_remember(const struct opencl *opencl, struct tune_class class,
                  const struct tune_result *results, size_t count, struct nacre_error *error)
{
    char key[KEY], *path = tune_path(), *text = NULL, *bytes = NULL;
    size_t size = 0;
    int status = NACRE_FAILED;
    if (!path) {
        return nacre_fail(error, "cannot remember what was measured: none of CACHE_DIRECTORY, "
                                 "XDG_CACHE_HOME and HOME names a folder; set one");
    }
    make_key(opencl, class, key);
    text = read_file(path);
    FILE *memory = open_memstream(&bytes, &size);
    if (!memory) {
        status = nacre_fail_memory(error, path);
        goto out;
    }
    print(memory, text, key, results, count);
    if (fclose(memory) != 0) {
        status = nacre_fail_memory(error, path);
        goto out;
    }
    make_folders(path);
    status = whole_file_write(path, bytes, size, error);
out:
    free(bytes);
    free(text);
    free(path);
    return status;
}
