/* Digests in POV-Ray's files: the CRC-32 of a text's other lines, or of a picture's pixels. */
#include "render/pov_digest.h"

#include "nacre/exr_file.h"
#include "nacre/half_float.h"

#include <errno.h>
#include <inttypes.h>
#include <libdeflate.h>
#include <stdlib.h>
#include <string.h>

enum { BLOCK = 1 << 16 };

#define BEFORE                                                                                     \
    "// Written by nacre render, which overwrites this file only where it is unchanged (crc32 "
#define AFTER     ").\n"
#define ATTRIBUTE "crc32"

/* Of what is left to read. */
static bool digest_rest(FILE *file, uint32_t *digest)
{
    unsigned char *block = malloc(BLOCK);
    size_t size = 0;
    *digest = 0;
    while (block && (size = fread(block, 1, BLOCK, file)) > 0) {
        *digest = libdeflate_crc32(*digest, block, size);
    }
    bool whole = block && !ferror(file);
    free(block);
    return whole;
}

/* Read the first line; false where it is none of ours. */
static bool read_first(FILE *file, uint32_t *digest)
{
    char line[sizeof BEFORE AFTER + 8], expected[sizeof line];
    if (!fgets(line, sizeof line, file) || strncmp(line, BEFORE, strlen(BEFORE)) != 0) {
        return false;
    }
    *digest = (uint32_t)strtoul(line + strlen(BEFORE), NULL, 16);
    (void)snprintf(expected, sizeof expected, BEFORE "%08" PRIx32 AFTER, *digest);
    return strcmp(line, expected) == 0;
}

int pov_text_open(struct output_file *output, char *path, struct nacre_error *error)
{
    int status = output_file_open(output, path, error);
    if (status == NACRE_OK) {
        (void)fprintf(output->file, BEFORE "%08" PRIx32 AFTER, UINT32_C(0)); /* until it is known */
    }
    return status;
}

/* Put the digest of what stands in the file on its disk into the first line. */
static int seal(const struct output_file *output, struct nacre_error *error)
{
    uint32_t digest = 0;
    FILE *file = fflush(output->file) == 0 ? fopen(output->whole.temporary, "re") : NULL;
    bool sealed = file && read_first(file, &digest) && digest_rest(file, &digest) &&
                  fseek(output->file, (long)strlen(BEFORE), SEEK_SET) == 0 &&
                  fprintf(output->file, "%08" PRIx32, digest) > 0;
    int number = errno;
    if (file) {
        (void)fclose(file);
    }
    return sealed ? NACRE_OK
                  : nacre_fail_errno(error, number, "%s: cannot be written", output->path);
}

int pov_text_close(struct output_file *output, int status, struct nacre_error *error)
{
    return output_file_close(output, status == NACRE_OK ? seal(output, error) : status, error);
}

/* Of the pixels as HALF keeps them, which is how they are written. */
static bool digest_picture(const struct picture *picture, uint32_t *digest)
{
    size_t row = 3 * (size_t)picture->width;
    float *values = malloc(row * sizeof *values);
    *digest = 0;
    for (int y = 0; values && y < picture->height; y++) {
        memcpy(values, picture->rgb + (size_t)y * row, row * sizeof *values);
        half_round(values, row);
        *digest = libdeflate_crc32(*digest, values, row * sizeof *values);
    }
    free(values);
    return values != NULL;
}

int pov_picture_write(char *path, const struct picture *picture, struct nacre_error *error)
{
    char attribute[sizeof ATTRIBUTE "=" + 8];
    const char *const attributes[] = {attribute, NULL};
    uint32_t digest;
    int status = NACRE_FAILED;
    if (!path || !digest_picture(picture, &digest)) {
        (void)nacre_fail_memory(error, "a picture for POV-Ray");
    } else {
        (void)snprintf(attribute, sizeof attribute, ATTRIBUTE "=%08" PRIx32, digest);
        status = picture_write(path, picture, attributes, error);
    }
    free(path);
    return status;
}

static bool picture_is_as_written(const char *path)
{
    struct nacre_error unused = {0};
    struct exr_file file = {0};
    struct picture picture = {0};
    uint32_t digest = 0;
    char expected[9];
    bool same = false;
    if (exr_file_read(path, &file, &unused) == NACRE_OK) {
        const struct exr_attribute *attribute =
            exr_part_find(&file.parts[0], "nacre." ATTRIBUTE, EXR_STRING);
        if (attribute && picture_read(path, &picture, &unused) == NACRE_OK &&
            digest_picture(&picture, &digest)) {
            (void)snprintf(expected, sizeof expected, "%08" PRIx32, digest);
            same = strcmp(attribute->string, expected) == 0;
        }
    }
    picture_finish(&picture);
    exr_file_finish(&file);
    return same;
}

static bool text_is_as_written(const char *path)
{
    uint32_t told = 0, digest = 0;
    FILE *file = fopen(path, "re");
    bool same = file && read_first(file, &told) && digest_rest(file, &digest) && told == digest;
    if (file) {
        (void)fclose(file);
    }
    return same;
}

bool pov_is_as_written(const char *path)
{
    const char *ending = strrchr(path, '.');
    return ending && strcmp(ending, ".exr") == 0 ? picture_is_as_written(path)
                                                 : text_is_as_written(path);
}
