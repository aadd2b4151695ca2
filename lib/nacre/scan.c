/* Opening a scan and reading its responses. */
#include "nacre/scan.h"

#include "channel.h"
#include "exr_stream.h"
#include "half_float.h"
#include "scan_window.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

/* What one thread needs to read: a context of its own (so that a message belongs to its tile) and
 * its buffers. */
struct decoder {
    struct decoder *next;
    struct exr_stream stream;
    exr_decode_pipeline_t pipeline;
    bool ready;
    char *packed; /* a tile as it lies in the file, where `plain` */
};

struct nacre_scan {
    struct nacre_scan_info info;
    char *path;
    struct exr_stream stream;
    int plane_of[3]; /* of each channel as OpenEXR orders them: its index in a response */
    bool plain;      /* uncompressed, all channels of the same type, in this machine's byte order */
    pthread_mutex_t mutex;
    struct decoder *idle; /* under the mutex */
};

size_t nacre_scan_response_size(const struct nacre_scan_info *info)
{
    return (size_t)info->channels * (size_t)info->window * (size_t)info->window;
}

void scan_window_clear_outside(const struct nacre_scan_info *info, int x, int y, float *response)
{
    int radius = (info->window - 1) / 2;
    int first = radius > x ? radius - x : 0;
    int end = x + radius >= info->width ? info->width - x + radius : info->window;
    bool rows_inside = y >= radius && y + radius < info->height;
    if (rows_inside && first == 0 && end == info->window) {
        return;
    }
    for (int row = 0; row < info->channels * info->window; row++, response += info->window) {
        int yo = y + row % info->window - radius;
        bool outside = yo < 0 || yo >= info->height;
        for (int u = 0; u < (outside ? info->window : first); u++) {
            response[u] = 0;
        }
        for (int u = end; u < info->window; u++) {
            response[u] = 0;
        }
    }
}

static int refuse(const struct nacre_scan *scan, struct nacre_error *error, const char *why)
{
    return nacre_fail(error, "%s: not a scan: %s", scan->path, why);
}

static int read_channels(struct nacre_scan *scan, struct nacre_error *error)
{
    const exr_attr_chlist_t *list = NULL;
    exr_result_t result = exr_get_channels(scan->stream.context, 0, &list);
    if (result != EXR_ERR_SUCCESS) {
        return exr_stream_fail(&scan->stream, result, error, "cannot read its channels");
    }
    if (list->num_channels != 1 && list->num_channels != 3) {
        return nacre_fail(error, "%s: not a scan: it has %d channels instead of R, G, B or Y",
                          scan->path, list->num_channels);
    }
    scan->info.channels = list->num_channels;
    scan->info.pixel = NACRE_HALF;
    scan->plain = __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__;
    for (int c = 0; c < list->num_channels; c++) {
        const exr_attr_chlist_entry_t *entry = &list->entries[c];
        int index = channel_find(list->num_channels, entry->name.str);
        if (index < 0) {
            return nacre_fail(error, "%s: not a scan: channel %.64s is none of R, G, B or Y alone",
                              scan->path, entry->name.str);
        }
        if (entry->pixel_type == EXR_PIXEL_UINT) {
            return nacre_fail(error, "%s: not a scan: channel %s is UINT, not HALF or FLOAT",
                              scan->path, entry->name.str);
        }
        if (entry->x_sampling != 1 || entry->y_sampling != 1) {
            return nacre_fail(error, "%s: not a scan: channel %s is subsampled", scan->path,
                              entry->name.str);
        }
        if (entry->pixel_type == EXR_PIXEL_FLOAT) {
            scan->info.pixel = NACRE_FLOAT;
        }
        scan->plain = scan->plain && entry->pixel_type == list->entries[0].pixel_type;
        scan->plane_of[c] = index;
    }
    return NACRE_OK;
}

/* A string attribute's text, or NULL where there is none of this name and type. */
static const char *string_attribute(const struct nacre_scan *scan, const char *name)
{
    const exr_attribute_t *attribute = NULL;
    if (exr_get_attribute_by_name(scan->stream.context, 0, name, &attribute) != EXR_ERR_SUCCESS ||
        attribute->type != EXR_ATTR_STRING || !attribute->string->str) {
        return NULL;
    }
    return attribute->string->str;
}

static int read_attributes(struct nacre_scan *scan, struct nacre_error *error)
{
    const exr_attribute_t *attribute = NULL;
    const char *format = string_attribute(scan, "nacre.format");
    if (!format) {
        return refuse(scan, error,
                      "the attribute nacre.format is missing; it should be "
                      "\"scan 1\"");
    }
    if (strcmp(format, "scan 1") != 0) {
        return nacre_fail(error,
                          "%s: not a scan: nacre.format is \"%.64s\", and this program reads "
                          "\"scan 1\"",
                          scan->path, format);
    }
    if (exr_get_attribute_by_name(scan->stream.context, 0, "nacre.pitch", &attribute) !=
            EXR_ERR_SUCCESS ||
        attribute->type != EXR_ATTR_FLOAT) {
        return refuse(scan, error,
                      "the attribute nacre.pitch (float, mm between surface points) is missing");
    }
    scan->info.pitch_mm = attribute->f;
    if (!(attribute->f > 0) || !isfinite(attribute->f)) {
        return nacre_fail(error, "%s: not a scan: nacre.pitch is %g mm; it must be positive",
                          scan->path, attribute->f);
    }
    if (exr_get_attribute_by_name(scan->stream.context, 0, "nacre.window", &attribute) ==
            EXR_ERR_SUCCESS &&
        (attribute->type != EXR_ATTR_INT || attribute->i != scan->info.window)) {
        return nacre_fail(error,
                          "%s: not a scan: nacre.window differs from the tiles of %d x %d pixels",
                          scan->path, scan->info.window, scan->info.window);
    }
    const char *source = string_attribute(scan, "nacre.source");
    if (source) {
        strncpy(scan->info.source, source, sizeof scan->info.source - 1);
    }
    return NACRE_OK;
}

static bool lossless(exr_compression_t compression)
{
    return compression == EXR_COMPRESSION_NONE || compression == EXR_COMPRESSION_RLE ||
           compression == EXR_COMPRESSION_ZIPS || compression == EXR_COMPRESSION_ZIP ||
           compression == EXR_COMPRESSION_PIZ;
}

/* Tiles, window and number of surface points. */
static int read_layout(struct nacre_scan *scan, struct nacre_error *error)
{
    exr_context_t context = scan->stream.context;
    exr_storage_t storage = EXR_STORAGE_LAST_TYPE;
    exr_attr_box2i_t window;
    uint32_t width = 0;
    uint32_t height = 0;
    exr_tile_level_mode_t level = EXR_TILE_LAST_TYPE;
    exr_tile_round_mode_t rounding = EXR_TILE_ROUND_LAST_TYPE;
    int parts = 0;
    if (exr_get_count(context, &parts) != EXR_ERR_SUCCESS || parts != 1) {
        return refuse(scan, error, "it has several parts, as a material has; a scan has one");
    }
    if (exr_get_storage(context, 0, &storage) != EXR_ERR_SUCCESS || storage != EXR_STORAGE_TILED) {
        return refuse(scan, error, "it has no tiles; a scan keeps each response in one tile");
    }
    exr_result_t result = exr_get_tile_descriptor(context, 0, &width, &height, &level, &rounding);
    if (result == EXR_ERR_SUCCESS) {
        result = exr_get_data_window(context, 0, &window);
    }
    if (result != EXR_ERR_SUCCESS) {
        return exr_stream_fail(&scan->stream, result, error, "cannot read its tile size");
    }
    if (width != height || width % 2 == 0 || width > INT32_MAX / 4) {
        return nacre_fail(error,
                          "%s: not a scan: its tiles are %u x %u pixels; they must be square and "
                          "odd",
                          scan->path, width, height);
    }
    if (level != EXR_TILE_ONE_LEVEL) {
        return refuse(scan, error, "it has several resolution levels");
    }
    int64_t columns = (int64_t)window.max.x - window.min.x + 1;
    int64_t rows = (int64_t)window.max.y - window.min.y + 1;
    if (columns < 1 || rows < 1 || columns % width != 0 || rows % width != 0) {
        return nacre_fail(error,
                          "%s: not a scan: its %lld x %lld pixels are no whole number of %u x %u "
                          "tiles",
                          scan->path, (long long)columns, (long long)rows, width, width);
    }
    scan->info.window = (int)width;
    scan->info.width = (int)(columns / width);
    scan->info.height = (int)(rows / width);
    return NACRE_OK;
}

/* Before anything is allocated or believed: a lossless file that can hold all the pixels, with its
 * chunk table whole. A tile cut off behind that is found when it is read. */
static int check_complete(struct nacre_scan *scan, struct nacre_error *error)
{
    exr_context_t context = scan->stream.context;
    exr_compression_t compression = EXR_COMPRESSION_LAST_TYPE;
    const struct nacre_scan_info *info = &scan->info;
    if (exr_get_compression(context, 0, &compression) != EXR_ERR_SUCCESS ||
        !lossless(compression)) {
        return refuse(scan, error, "its compression loses data; write it uncompressed or with ZIP");
    }
    scan->plain = scan->plain && compression == EXR_COMPRESSION_NONE;
    uint64_t tile = (uint64_t)info->window * (uint64_t)info->window * (uint64_t)info->channels *
                    (info->pixel == NACRE_HALF ? 2 : 4);
    uint64_t count = (uint64_t)info->width * (uint64_t)info->height;
    if (tile > exr_stream_plausible(scan->stream.size, compression) / count) {
        return nacre_fail(error,
                          "%s: an incomplete file: it is too short for the %d x %d responses its "
                          "header announces; make it again",
                          scan->path, info->width, info->height);
    }
    if (!exr_stream_complete(&scan->stream, count)) {
        return nacre_fail(error,
                          "%s: an incomplete file: not all of its %d x %d responses are there; "
                          "make it again",
                          scan->path, info->width, info->height);
    }
    return NACRE_OK;
}

int nacre_scan_open(const char *path, struct nacre_scan **scan, struct nacre_error *error)
{
    int status = NACRE_OK;
    *scan = NULL;
    struct nacre_scan *made = calloc(1, sizeof *made);
    if (!made) {
        return nacre_fail_memory(error, path);
    }
    (void)pthread_mutex_init(&made->mutex, NULL); /* cannot fail on Linux */
    made->path = strdup(path);
    status =
        made->path ? exr_stream_open(&made->stream, path, error) : nacre_fail_memory(error, path);
    if (status == NACRE_OK) {
        status = read_layout(made, error);
    }
    if (status == NACRE_OK) {
        status = read_channels(made, error);
    }
    if (status == NACRE_OK) {
        status = read_attributes(made, error);
    }
    if (status == NACRE_OK) {
        status = check_complete(made, error);
    }
    if (status == NACRE_OK) {
        *scan = made;
        made = NULL;
    }
    nacre_scan_close(made);
    return status;
}

const struct nacre_scan_info *nacre_scan_info(const struct nacre_scan *scan)
{
    return &scan->info;
}

const char *nacre_scan_path(const struct nacre_scan *scan)
{
    return scan->path;
}

static void decoder_free(struct decoder *decoder)
{
    if (decoder) {
        if (decoder->ready) {
            (void)exr_decoding_destroy(decoder->stream.context, &decoder->pipeline);
        }
        exr_stream_finish(&decoder->stream);
        free(decoder->packed);
        free(decoder);
    }
}

static size_t pixel_bytes(const struct nacre_scan *scan)
{
    return scan->info.pixel == NACRE_HALF ? 2 : 4;
}

/* An idle decoder, or a new one: there are never more than threads that read at once. */
static struct decoder *decoder_take(struct nacre_scan *scan, struct nacre_error *error)
{
    (void)pthread_mutex_lock(&scan->mutex);
    struct decoder *decoder = scan->idle;
    if (decoder) {
        scan->idle = decoder->next;
    }
    (void)pthread_mutex_unlock(&scan->mutex);
    if (decoder) {
        return decoder;
    }
    decoder = calloc(1, sizeof *decoder);
    if (!decoder) {
        (void)nacre_fail_memory(error, scan->path);
    } else if (exr_stream_share(&decoder->stream, &scan->stream, error) != NACRE_OK) {
        free(decoder);
        decoder = NULL;
    } else if (scan->plain) {
        decoder->packed = malloc(nacre_scan_response_size(&scan->info) * pixel_bytes(scan));
        if (!decoder->packed) {
            (void)nacre_fail_memory(error, scan->path);
            decoder_free(decoder);
            decoder = NULL;
        }
    }
    return decoder;
}

static void decoder_return(struct nacre_scan *scan, struct decoder *decoder)
{
    (void)pthread_mutex_lock(&scan->mutex);
    decoder->next = scan->idle;
    scan->idle = decoder;
    (void)pthread_mutex_unlock(&scan->mutex);
}

/* A tile that is stored as it is: line after line, in each channel after channel. OpenEXR would ask the system for each
 * of them. */
static exr_result_t read_plain(struct decoder *decoder, const struct nacre_scan *scan, int x, int y,
                               float *response)
{
    exr_context_t context = decoder->stream.context;
    size_t window = (size_t)scan->info.window, line = window * pixel_bytes(scan);
    const char *from = decoder->packed;
    exr_chunk_info_t chunk;
    exr_result_t result = exr_read_tile_chunk_info(context, 0, x, y, 0, 0, &chunk);
    if (result == EXR_ERR_SUCCESS) {
        result = chunk.packed_size == nacre_scan_response_size(&scan->info) * pixel_bytes(scan)
                     ? exr_read_chunk(context, 0, &chunk, decoder->packed)
                     : EXR_ERR_BAD_CHUNK_LEADER;
    }
    for (size_t v = 0; v < window && result == EXR_ERR_SUCCESS; v++) {
        for (int c = 0; c < scan->info.channels; c++, from += line) {
            float *to = response + ((size_t)scan->plane_of[c] * window + v) * window;
            if (scan->info.pixel == NACRE_HALF) {
                half_unpack(from, window, to);
            } else {
                memcpy(to, from, line);
            }
        }
    }
    return result;
}

static exr_result_t decode(struct decoder *decoder, const struct nacre_scan *scan, int x, int y,
                           float *response)
{
    exr_context_t context = decoder->stream.context;
    exr_decode_pipeline_t *pipeline = &decoder->pipeline;
    exr_chunk_info_t chunk;
    exr_result_t result = exr_read_tile_chunk_info(context, 0, x, y, 0, 0, &chunk);
    if (result == EXR_ERR_SUCCESS) {
        result = decoder->ready ? exr_decoding_update(context, 0, &chunk, pipeline)
                                : exr_decoding_initialize(context, 0, &chunk, pipeline);
    }
    if (result != EXR_ERR_SUCCESS) {
        return result;
    }
    int window = scan->info.window;
    for (int c = 0; c < pipeline->channel_count; c++) {
        exr_coding_channel_info_t *channel = &pipeline->channels[c];
        channel->user_data_type = EXR_PIXEL_FLOAT;
        channel->user_bytes_per_element = sizeof(float);
        channel->user_pixel_stride = sizeof(float);
        channel->user_line_stride = window * (int)sizeof(float);
        channel->decode_to_ptr =
            (uint8_t *)(response + (size_t)scan->plane_of[c] * (size_t)window * (size_t)window);
    }
    if (!decoder->ready) {
        decoder->ready = true;
        result = exr_decoding_choose_default_routines(context, 0, pipeline);
    }
    return result == EXR_ERR_SUCCESS ? exr_decoding_run(context, 0, pipeline) : result;
}

int nacre_scan_read(const struct nacre_scan *scan, int x, int y, float *response,
                    struct nacre_error *error)
{
    const struct nacre_scan_info *info = &scan->info;
    if (x < 0 || y < 0 || x >= info->width || y >= info->height) {
        return nacre_fail(error, "%s: there is no surface point (%d, %d); the scan has %d x %d",
                          scan->path, x, y, info->width, info->height);
    }
    /* Reading changes nothing that the caller could see: only the list of idle decoders. */
    struct nacre_scan *shared = (struct nacre_scan *)scan;
    struct decoder *decoder = decoder_take(shared, error);
    if (!decoder) {
        return NACRE_FAILED;
    }
    exr_result_t result = scan->plain ? read_plain(decoder, scan, x, y, response)
                                      : decode(decoder, scan, x, y, response);
    if (result != EXR_ERR_SUCCESS) {
        int status =
            exr_stream_fail(&decoder->stream, result, error,
                            "tile (%d, %d) is damaged or incomplete; make the scan again", x, y);
        decoder_free(decoder); /* its state after a failure is OpenEXR's secret */
        return status;
    }
    decoder_return(shared, decoder);
    scan_window_clear_outside(info, x, y, response);
    return NACRE_OK;
}

void nacre_scan_close(struct nacre_scan *scan)
{
    if (!scan) {
        return;
    }
    while (scan->idle) {
        struct decoder *decoder = scan->idle;
        scan->idle = decoder->next;
        decoder_free(decoder);
    }
    exr_stream_finish(&scan->stream);
    (void)pthread_mutex_destroy(&scan->mutex);
    free(scan->path);
    free(scan);
}
