/* Writing an OpenEXR file from memory. */
#include "exr_stream.h"
#include "nacre/exr_file.h"
#include "nacre/whole_file.h"

#include <stdlib.h>
#include <string.h>

static int fail(const struct exr_stream *stream, const struct exr_part *part, exr_result_t result,
                struct nacre_error *error)
{
    if (part->name[0]) {
        return exr_stream_fail(stream, result, error, "part %s: cannot write", part->name);
    }
    return exr_stream_fail(stream, result, error, "cannot write");
}

static exr_pixel_type_t stored_type(enum nacre_pixel pixel)
{
    switch (pixel) {
    case NACRE_UINT:
        return EXR_PIXEL_UINT;
    case NACRE_HALF:
        return EXR_PIXEL_HALF;
    default:
        return EXR_PIXEL_FLOAT;
    }
}

static exr_result_t write_attribute(exr_context_t context, int index,
                                    const struct exr_attribute *attribute)
{
    switch (attribute->kind) {
    case EXR_INT:
        return exr_attr_set_int(context, index, attribute->name, attribute->integer);
    case EXR_FLOAT:
        return exr_attr_set_float(context, index, attribute->name, attribute->real);
    case EXR_STRING:
        return exr_attr_set_string(context, index, attribute->name, attribute->string);
    case EXR_FLOATS:
        return exr_attr_set_float_vector(context, index, attribute->name, (int32_t)attribute->count,
                                         attribute->floats);
    case EXR_STRINGS:
        return exr_attr_set_string_vector(context, index, attribute->name,
                                          (int32_t)attribute->count,
                                          (const char **)attribute->strings);
    }
    return EXR_ERR_INVALID_ARGUMENT;
}

/* Declare one part with its channels and attributes. */
static exr_result_t declare_part(exr_context_t context, const struct exr_part *part,
                                 const exr_attr_box2i_t *display, enum exr_compression compression)
{
    int index = 0;
    exr_attr_box2i_t data = {.max = {.x = part->width - 1, .y = part->height - 1}};
    exr_attr_v2f_t centre = {.x = 0, .y = 0};
    exr_result_t result =
        exr_add_part(context, part->name[0] ? part->name : NULL, EXR_STORAGE_SCANLINE, &index);
    if (result == EXR_ERR_SUCCESS) {
        result = exr_initialize_required_attr(
            context, index, display, &data, 1, &centre, 1, EXR_LINEORDER_INCREASING_Y,
            compression == EXR_UNCOMPRESSED ? EXR_COMPRESSION_NONE : EXR_COMPRESSION_ZIP);
    }
    if (result == EXR_ERR_SUCCESS && compression == EXR_ZIP_FAST) {
        result = exr_set_zip_compression_level(context, index, 1);
    }
    for (size_t i = 0; i < part->plane_count && result == EXR_ERR_SUCCESS; i++) {
        result =
            exr_add_channel(context, index, part->planes[i].name,
                            stored_type(part->planes[i].pixel), EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
    }
    for (size_t i = 0; i < part->attribute_count && result == EXR_ERR_SUCCESS; i++) {
        result = write_attribute(context, index, &part->attributes[i]);
    }
    return result;
}

/* Which plane each of the pipeline's channels, which OpenEXR has sorted, is written from. */
static void match_planes(const exr_encode_pipeline_t *encode, const struct exr_part *part,
                         size_t *planes)
{
    for (int c = 0; c < encode->channel_count; c++) {
        planes[c] = 0;
        while (planes[c] + 1 < part->plane_count &&
               strcmp(part->planes[planes[c]].name, encode->channels[c].channel_name) != 0) {
            planes[c]++;
        }
    }
}

/* Point the pipeline's channels at row y of their planes. */
static void aim(exr_encode_pipeline_t *encode, const struct exr_part *part, const size_t *planes,
                int y)
{
    for (int c = 0; c < encode->channel_count; c++) {
        exr_coding_channel_info_t *channel = &encode->channels[c];
        const struct exr_plane *plane = &part->planes[planes[c]];
        bool integer = plane->pixel == NACRE_UINT;
        channel->user_data_type = integer ? EXR_PIXEL_UINT : EXR_PIXEL_FLOAT;
        channel->user_bytes_per_element = 4;
        channel->user_pixel_stride = 4;
        channel->user_line_stride = part->width * 4;
        channel->encode_from_ptr =
            (const uint8_t *)(plane->values + (size_t)y * (size_t)part->width);
    }
}

static int write_pixels(struct exr_stream *stream, int index, const struct exr_part *part,
                        struct nacre_error *error)
{
    exr_encode_pipeline_t encode = EXR_ENCODE_PIPELINE_INITIALIZER;
    exr_context_t context = stream->context;
    bool encoding = false;
    int32_t lines = 1;
    int status = NACRE_OK;
    size_t *planes = calloc(part->plane_count, sizeof *planes);
    exr_result_t result = exr_get_scanlines_per_chunk(context, index, &lines);
    if (!planes) {
        status = nacre_fail_memory(error, stream->path);
        goto out;
    }
    for (int y = 0; y < part->height && result == EXR_ERR_SUCCESS; y += lines) {
        exr_chunk_info_t chunk;
        result = exr_write_scanline_chunk_info(context, index, y, &chunk);
        if (result == EXR_ERR_SUCCESS) {
            result = encoding ? exr_encoding_update(context, index, &chunk, &encode)
                              : exr_encoding_initialize(context, index, &chunk, &encode);
        }
        if (result != EXR_ERR_SUCCESS) {
            break;
        }
        if (!encoding) {
            match_planes(&encode, part, planes);
        }
        aim(&encode, part, planes, y);
        if (!encoding) {
            encoding = true;
            result = exr_encoding_choose_default_routines(context, index, &encode);
            encode.yield_until_ready_fn = NULL;
            encode.write_fn = NULL;
        }
        if (result == EXR_ERR_SUCCESS) {
            result = exr_encoding_run(context, index, &encode);
        }
        if (result == EXR_ERR_SUCCESS) {
            exr_stream_settle(&encode);
            result = exr_write_scanline_chunk(context, index, y, encode.compressed_buffer,
                                              encode.compressed_bytes);
        }
    }
    if (result != EXR_ERR_SUCCESS) {
        status = fail(stream, part, result, error);
    }
out:
    if (encoding) {
        (void)exr_encoding_destroy(context, &encode);
    }
    free(planes);
    return status;
}

/* Names and sizes that OpenEXR cannot write are told before a file is begun. */
static int check(const char *path, const struct exr_file *file, struct nacre_error *error)
{
    if (file->part_count == 0) {
        return nacre_fail(error, "%s: cannot write: it has no parts", path);
    }
    for (size_t p = 0; p < file->part_count; p++) {
        const struct exr_part *part = &file->parts[p];
        if (file->part_count > 1 && part->name[0] == '\0') {
            return nacre_fail(error, "%s: cannot write: part %zu has no name", path, p);
        }
        if (exr_file_find_part(file, part->name) != part) {
            return nacre_fail(error, "%s: cannot write: two parts are named %s", path, part->name);
        }
        if (part->width < 1 || part->height < 1 || part->width > INT32_MAX / 4) {
            return nacre_fail(error, "%s: cannot write: part %s is %d x %d pixels", path,
                              part->name, part->width, part->height);
        }
        if (part->plane_count == 0) {
            return nacre_fail(error, "%s: cannot write: part %s has no channels", path, part->name);
        }
        for (size_t i = 0; i < part->plane_count; i++) {
            if (exr_part_find_plane(part, part->planes[i].name) != &part->planes[i]) {
                return nacre_fail(error, "%s: cannot write: part %s has channel %s twice", path,
                                  part->name, part->planes[i].name);
            }
        }
    }
    return NACRE_OK;
}

static bool has_long_names(const struct exr_file *file)
{
    enum { SHORT_NAME = 31 };
    for (size_t p = 0; p < file->part_count; p++) {
        const struct exr_part *part = &file->parts[p];
        for (size_t i = 0; i < part->plane_count; i++) {
            if (strlen(part->planes[i].name) > SHORT_NAME) {
                return true;
            }
        }
        for (size_t i = 0; i < part->attribute_count; i++) {
            if (strlen(part->attributes[i].name) > SHORT_NAME) {
                return true;
            }
        }
    }
    return false;
}

static int write_header(struct exr_stream *stream, const struct exr_file *file,
                        enum exr_compression compression, struct nacre_error *error)
{
    exr_attr_box2i_t display = {0};
    for (size_t p = 0; p < file->part_count; p++) {
        const struct exr_part *part = &file->parts[p];
        display.max.x = part->width - 1 > display.max.x ? part->width - 1 : display.max.x;
        display.max.y = part->height - 1 > display.max.y ? part->height - 1 : display.max.y;
    }
    if (has_long_names(file)) {
        (void)exr_set_longname_support(stream->context, 1); /* else the name itself is refused */
    }
    for (size_t p = 0; p < file->part_count; p++) {
        exr_result_t result = declare_part(stream->context, &file->parts[p], &display, compression);
        if (result != EXR_ERR_SUCCESS) {
            return fail(stream, &file->parts[p], result, error);
        }
    }
    exr_result_t result = exr_write_header(stream->context);
    return result == EXR_ERR_SUCCESS ? NACRE_OK
                                     : exr_stream_fail(stream, result, error, "cannot write");
}

int exr_file_write(const char *path, const struct exr_file *file, enum exr_compression compression,
                   struct nacre_error *error)
{
    struct whole_file whole = {0};
    struct exr_stream stream = {0};
    int status = check(path, file, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = whole_file_create(&whole, path, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = exr_stream_create(&stream, whole.temporary, path, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = write_header(&stream, file, compression, error);
    for (size_t p = 0; p < file->part_count && status == NACRE_OK; p++) {
        status = write_pixels(&stream, (int)p, &file->parts[p], error);
    }
    if (status == NACRE_OK) {
        status = exr_stream_close(&stream, error);
    }
    if (status == NACRE_OK) {
        status = whole_file_commit(&whole, error);
    }
out:
    exr_stream_finish(&stream);
    whole_file_discard(&whole);
    return status;
}
