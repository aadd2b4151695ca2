/* Reading an OpenEXR file into memory. */
#include "exr_stream.h"
#include "exr_unzip.h"
#include "nacre/exr_file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* What is being read: the part as OpenEXR numbers it, and where it goes. */
struct reader {
    struct exr_stream stream;
    int index;
    const char *name; /* of the part, for messages; "" in a file of one part */
    exr_storage_t storage;
    exr_attr_box2i_t window;
    struct exr_part *part;
    exr_decode_pipeline_t decode;
    bool decoding;
    struct exr_unzip unzip;
};

/* "part F: " or nothing. */
static const char *part_prefix(const struct reader *reader, char text[80])
{
    text[0] = '\0';
    if (reader->name[0]) {
        (void)snprintf(text, 80, "part %.60s: ", reader->name);
    }
    return text;
}

static int fail(const struct reader *reader, exr_result_t result, struct nacre_error *error,
                const char *what)
{
    char prefix[80];
    return exr_stream_fail(&reader->stream, result, error, "%s%s", part_prefix(reader, prefix),
                           what);
}

static int refuse(const struct reader *reader, struct nacre_error *error, const char *why)
{
    char prefix[80];
    return nacre_fail(error, "%s: %s%s", reader->stream.path, part_prefix(reader, prefix), why);
}

static int copy_strings(struct exr_part *part, const char *name,
                        const exr_attr_string_vector_t *vector)
{
    size_t count = vector->n_strings > 0 ? (size_t)vector->n_strings : 0;
    const char **strings = calloc(count ? count : 1, sizeof *strings);
    if (!strings) {
        return NACRE_FAILED;
    }
    for (size_t i = 0; i < count; i++) {
        strings[i] = vector->strings[i].str ? vector->strings[i].str : "";
    }
    int status = exr_part_add_strings(part, name, strings, count);
    free(strings);
    return status;
}

static int copy_attribute(struct exr_part *part, const exr_attribute_t *attribute)
{
    switch (attribute->type) {
    case EXR_ATTR_INT:
        return exr_part_add_int(part, attribute->name, attribute->i);
    case EXR_ATTR_FLOAT:
        return exr_part_add_float(part, attribute->name, attribute->f);
    case EXR_ATTR_STRING:
        return exr_part_add_string(part, attribute->name,
                                   attribute->string->str ? attribute->string->str : "");
    case EXR_ATTR_FLOAT_VECTOR:
        return exr_part_add_floats(
            part, attribute->name, attribute->floatvector->arr,
            attribute->floatvector->length > 0 ? (size_t)attribute->floatvector->length : 0);
    case EXR_ATTR_STRING_VECTOR:
        return copy_strings(part, attribute->name, attribute->stringvector);
    default:
        return NACRE_OK; /* of no kind that nacre writes */
    }
}

static int read_attributes(struct reader *reader, struct nacre_error *error)
{
    int32_t count = 0;
    exr_result_t result = exr_get_attribute_count(reader->stream.context, reader->index, &count);
    for (int32_t i = 0; i < count && result == EXR_ERR_SUCCESS; i++) {
        const exr_attribute_t *attribute = NULL;
        result = exr_get_attribute_by_index(reader->stream.context, reader->index,
                                            EXR_ATTR_LIST_FILE_ORDER, i, &attribute);
        if (result != EXR_ERR_SUCCESS || strncmp(attribute->name, "nacre.", 6) != 0 ||
            strlen(attribute->name) >= sizeof reader->part->attributes->name) {
            continue;
        }
        if (copy_attribute(reader->part, attribute) != NACRE_OK) {
            return nacre_fail_memory(error, reader->stream.path);
        }
    }
    return result == EXR_ERR_SUCCESS ? NACRE_OK
                                     : fail(reader, result, error, "cannot read its attributes");
}

static size_t stored_width(exr_pixel_type_t type)
{
    return type == EXR_PIXEL_HALF ? 2 : 4;
}

/* Before anything is allocated: channels we can hold, and pixels that the file can hold. */
static int check_part(const struct reader *reader, const exr_attr_chlist_t *channels,
                      exr_compression_t compression, struct nacre_error *error)
{
    int64_t width = (int64_t)reader->window.max.x - reader->window.min.x + 1;
    int64_t height = (int64_t)reader->window.max.y - reader->window.min.y + 1;
    if (reader->storage != EXR_STORAGE_SCANLINE && reader->storage != EXR_STORAGE_TILED) {
        return refuse(reader, error, "deep pixels are not supported");
    }
    if (width < 1 || height < 1 || width > INT32_MAX / 4 || height > INT32_MAX / 4) {
        return refuse(reader, error, "its data window has an impossible size");
    }
    uint64_t bytes = 0;
    for (int c = 0; c < channels->num_channels; c++) {
        const exr_attr_chlist_entry_t *entry = &channels->entries[c];
        if (entry->x_sampling != 1 || entry->y_sampling != 1) {
            return refuse(reader, error, "subsampled channels are not supported");
        }
        if (strlen(entry->name.str) >= sizeof reader->part->planes->name) {
            return refuse(reader, error, "a channel's name is longer than 63 characters");
        }
        bytes += stored_width(entry->pixel_type);
    }
    uint64_t plausible = exr_stream_plausible(reader->stream.size, compression);
    if (bytes > 0 && (uint64_t)width * (uint64_t)height > plausible / bytes) {
        return refuse(reader, error,
                      "an incomplete file: it is too short for the pixels its header announces; "
                      "make it again");
    }
    return NACRE_OK;
}

static int add_planes(struct reader *reader, const exr_attr_chlist_t *channels,
                      struct nacre_error *error)
{
    for (int c = 0; c < channels->num_channels; c++) {
        const exr_attr_chlist_entry_t *entry = &channels->entries[c];
        enum nacre_pixel pixel = entry->pixel_type == EXR_PIXEL_UINT   ? NACRE_UINT
                                 : entry->pixel_type == EXR_PIXEL_HALF ? NACRE_HALF
                                                                       : NACRE_FLOAT;
        if (!exr_part_add_plane(reader->part, entry->name.str, pixel)) {
            return nacre_fail_memory(error, reader->stream.path);
        }
    }
    return NACRE_OK;
}

/* Read one chunk whose first pixel is (x, y) of the part. */
static int decode_chunk(struct reader *reader, const exr_chunk_info_t *chunk, int x, int y,
                        struct nacre_error *error)
{
    exr_context_t context = reader->stream.context;
    exr_decode_pipeline_t *decode = &reader->decode;
    exr_result_t result = reader->decoding
                              ? exr_decoding_update(context, reader->index, chunk, decode)
                              : exr_decoding_initialize(context, reader->index, chunk, decode);
    if (result != EXR_ERR_SUCCESS) {
        return fail(reader, result, error, "cannot decode its pixels");
    }
    const struct exr_part *part = reader->part;
    for (int c = 0; c < decode->channel_count; c++) {
        exr_coding_channel_info_t *channel = &decode->channels[c];
        size_t offset = (size_t)y * (size_t)part->width + (size_t)x;
        bool integer = part->planes[c].pixel == NACRE_UINT;
        channel->user_data_type = integer ? EXR_PIXEL_UINT : EXR_PIXEL_FLOAT;
        channel->user_bytes_per_element = 4;
        channel->user_pixel_stride = 4;
        channel->user_line_stride = part->width * 4;
        channel->decode_to_ptr = (uint8_t *)(part->planes[c].values + offset);
    }
    if (!reader->decoding) {
        reader->decoding = true;
        result = exr_decoding_choose_default_routines(context, reader->index, decode);
        exr_unzip_use(&reader->unzip, decode);
    }
    if (result == EXR_ERR_SUCCESS) {
        result = exr_decoding_run(context, reader->index, decode);
    }
    if (result != EXR_ERR_SUCCESS) {
        char what[80];
        (void)snprintf(what, sizeof what,
                       "the pixels from (%d, %d) on are damaged or incomplete; make it again", x,
                       y);
        return fail(reader, result, error, what);
    }
    return NACRE_OK;
}

static int read_scanlines(struct reader *reader, struct nacre_error *error)
{
    int32_t lines = 1;
    exr_result_t result =
        exr_get_scanlines_per_chunk(reader->stream.context, reader->index, &lines);
    for (int y = 0; y < reader->part->height && result == EXR_ERR_SUCCESS; y += lines) {
        exr_chunk_info_t chunk;
        result = exr_read_scanline_chunk_info(reader->stream.context, reader->index,
                                              reader->window.min.y + y, &chunk);
        if (result == EXR_ERR_SUCCESS) {
            int status = decode_chunk(reader, &chunk, 0, y, error);
            if (status != NACRE_OK) {
                return status;
            }
        }
    }
    return result == EXR_ERR_SUCCESS
               ? NACRE_OK
               : fail(reader, result, error, "an incomplete file; make it again");
}

static int read_tiles(struct reader *reader, struct nacre_error *error)
{
    exr_context_t context = reader->stream.context;
    int32_t width = 0;
    int32_t height = 0;
    exr_result_t result = exr_get_tile_sizes(context, reader->index, 0, 0, &width, &height);
    if (result == EXR_ERR_SUCCESS && (width < 1 || height < 1)) {
        return refuse(reader, error, "its tiles have no size");
    }
    for (int y = 0; y < reader->part->height && result == EXR_ERR_SUCCESS; y += height) {
        for (int x = 0; x < reader->part->width && result == EXR_ERR_SUCCESS; x += width) {
            exr_chunk_info_t chunk;
            result = exr_read_tile_chunk_info(context, reader->index, x / width, y / height, 0, 0,
                                              &chunk);
            if (result == EXR_ERR_SUCCESS) {
                int status = decode_chunk(reader, &chunk, x, y, error);
                if (status != NACRE_OK) {
                    return status;
                }
            }
        }
    }
    return result == EXR_ERR_SUCCESS
               ? NACRE_OK
               : fail(reader, result, error, "an incomplete file; make it again");
}

static int read_part(struct reader *reader, struct exr_file *file, struct nacre_error *error)
{
    exr_context_t context = reader->stream.context;
    const exr_attr_chlist_t *channels = NULL;
    exr_compression_t compression = EXR_COMPRESSION_NONE;
    const char *name = NULL;
    reader->name = "";
    if (exr_get_name(context, reader->index, &name) == EXR_ERR_SUCCESS && name) {
        reader->name = name;
    }
    exr_result_t result = exr_get_storage(context, reader->index, &reader->storage);
    if (result == EXR_ERR_SUCCESS) {
        result = exr_get_data_window(context, reader->index, &reader->window);
    }
    if (result == EXR_ERR_SUCCESS) {
        result = exr_get_channels(context, reader->index, &channels);
    }
    if (result == EXR_ERR_SUCCESS) {
        result = exr_get_compression(context, reader->index, &compression);
    }
    if (result != EXR_ERR_SUCCESS) {
        return fail(reader, result, error, "its header lacks a required attribute");
    }
    if (strlen(reader->name) >= sizeof reader->part->name) {
        return refuse(reader, error, "a part's name is longer than 63 characters");
    }
    int status = check_part(reader, channels, compression, error);
    if (status != NACRE_OK) {
        return status;
    }
    reader->part =
        exr_file_add_part(file, reader->name, reader->window.max.x - reader->window.min.x + 1,
                          reader->window.max.y - reader->window.min.y + 1);
    if (!reader->part) {
        return nacre_fail_memory(error, reader->stream.path);
    }
    status = add_planes(reader, channels, error);
    if (status == NACRE_OK) {
        status = read_attributes(reader, error);
    }
    if (status == NACRE_OK) {
        status = reader->storage == EXR_STORAGE_TILED ? read_tiles(reader, error)
                                                      : read_scanlines(reader, error);
    }
    if (reader->decoding) {
        (void)exr_decoding_destroy(context, &reader->decode);
        reader->decoding = false;
    }
    return status;
}

int exr_file_read(const char *path, struct exr_file *file, struct nacre_error *error)
{
    struct reader reader = {0};
    int count = 0;
    *file = (struct exr_file){0};
    int status = exr_stream_open(&reader.stream, path, error);
    if (status != NACRE_OK) {
        goto out;
    }
    exr_result_t result = exr_get_count(reader.stream.context, &count);
    if (result != EXR_ERR_SUCCESS) {
        status = exr_stream_fail(&reader.stream, result, error, "cannot read");
    }
    for (reader.index = 0; reader.index < count && status == NACRE_OK; reader.index++) {
        status = read_part(&reader, file, error);
    }
out:
    exr_unzip_finish(&reader.unzip);
    exr_stream_finish(&reader.stream);
    if (status != NACRE_OK) {
        exr_file_finish(file);
    }
    return status;
}
