/* Small and middling OpenEXR files in memory: parts made of named planes and attributes. Scans, which may be larger
 * than memory, have their own reader and writer in scan.h. */
#ifndef NACRE_EXR_FILE_H
#define NACRE_EXR_FILE_H

#include "nacre/error.h"
#include "nacre/pixel.h"

#include <stddef.h>
#include <stdint.h>

/* One channel of one part. HALF and FLOAT planes are float[height][width] in memory, UINT planes
 * uint32_t[height][width]. */
struct exr_plane {
    char name[64];
    enum nacre_pixel pixel; /* as stored in the file */
    union {
        float *values;
        uint32_t *integers;
    };
};

enum exr_attribute_kind { EXR_INT, EXR_FLOAT, EXR_STRING, EXR_FLOATS, EXR_STRINGS };

struct exr_attribute {
    char name[64];
    enum exr_attribute_kind kind;
    size_t count;   /* of EXR_FLOATS and EXR_STRINGS */
    int integer;    /* EXR_INT */
    float real;     /* EXR_FLOAT */
    char *string;   /* EXR_STRING */
    float *floats;  /* EXR_FLOATS */
    char **strings; /* EXR_STRINGS */
};

struct exr_part {
    char name[64]; /* may be empty in a file of one part */
    int width, height;
    size_t plane_count, attribute_count;
    struct exr_plane *planes;
    struct exr_attribute *attributes; /* those whose name begins with "nacre." */
};

struct exr_file {
    size_t part_count;
    struct exr_part *parts;
};

/* Fast ZIP is for pictures that are mostly noise: a sixth larger in a third of the time. */
enum exr_compression { EXR_UNCOMPRESSED, EXR_ZIP, EXR_ZIP_FAST };

/* Read a whole file. `file` is filled on success and left empty on failure. Scanline and tiled parts are read; deep
 * and subsampled ones are refused. Reading checks sizes before allocating. */
int exr_file_read(const char *path, struct exr_file *file, struct nacre_error *error);

/* Write a whole file (see whole_file.h): scanline parts, display window as large as the largest part, every value
 * rounded to its plane's stored type. Plane order means nothing. */
int exr_file_write(const char *path, const struct exr_file *file, enum exr_compression compression,
                   struct nacre_error *error);

/* Free everything the file holds and empty it. */
void exr_file_finish(struct exr_file *file);

/* Building: each returns what it added, owned by the file, or NULL when memory runs out. Pointers returned earlier to
 * parts, planes or attributes of the same list are no longer valid. Planes come zeroed. */
struct exr_part *exr_file_add_part(struct exr_file *file, const char *name, int width, int height);
struct exr_plane *exr_part_add_plane(struct exr_part *part, const char *name,
                                     enum nacre_pixel pixel);
int exr_part_add_int(struct exr_part *part, const char *name, int value);
int exr_part_add_float(struct exr_part *part, const char *name, float value);
int exr_part_add_string(struct exr_part *part, const char *name, const char *value);
int exr_part_add_floats(struct exr_part *part, const char *name, const float *values, size_t count);
int exr_part_add_strings(struct exr_part *part, const char *name, const char *const *values,
                         size_t count);

/* Looking up: NULL when there is none. */
struct exr_part *exr_file_find_part(const struct exr_file *file, const char *name);
struct exr_plane *exr_part_find_plane(const struct exr_part *part, const char *name);
const struct exr_attribute *exr_part_find(const struct exr_part *part, const char *name,
                                          enum exr_attribute_kind kind);

#endif
