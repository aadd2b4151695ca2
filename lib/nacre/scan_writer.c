/* Writing a scan, one response a tile. */
#include "channel.h"
#include "exr_stream.h"
#include "nacre/whole_file.h"
#include "scan_window.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Tiles that are compressed at the same time. They are written in the order in which they came, so that a scan's bytes
 * depend on nothing but its responses and their order. */
enum { BATCH = 128 };

/* One tile on its way. */
struct tile {
    int x, y;
    float *response; /* [channels][K][K], as it is stored */
    exr_encode_pipeline_t pipeline;
    bool ready; /* the pipeline */
    exr_result_t result;
};

struct nacre_scan_writer {
    struct nacre_scan_info info;
    char *path;
    struct whole_file whole;
    struct exr_stream stream;
    struct tile tiles[BATCH];
    int capacity, count; /* of tiles: those that are used, and those that wait */
    bool *written;       /* [height][width] */
};

static int check_info(const char *path, const struct nacre_scan_info *info,
                      struct nacre_error *error)
{
    if (info->width < 1 || info->height < 1) {
        return nacre_fail(error, "%s: cannot write a scan of %d x %d surface points", path,
                          info->width, info->height);
    }
    if (info->window < 1 || info->window % 2 == 0) {
        return nacre_fail(error, "%s: cannot write a scan with a window of %d; it must be odd",
                          path, info->window);
    }
    if (info->channels != 1 && info->channels != 3) {
        return nacre_fail(error, "%s: cannot write a scan of %d channels; it must be 1 or 3", path,
                          info->channels);
    }
    if (info->pixel != NACRE_HALF && info->pixel != NACRE_FLOAT) {
        return nacre_fail(error, "%s: cannot write a scan of integers; store HALF or FLOAT", path);
    }
    if (!(info->pitch_mm > 0) || !isfinite(info->pitch_mm)) {
        return nacre_fail(error, "%s: cannot write a scan with a pitch of %g mm", path,
                          info->pitch_mm);
    }
    /* OpenEXR's own limit on either side of an image */
    int64_t limit = INT32_MAX / 4;
    if ((int64_t)info->width * info->window > limit ||
        (int64_t)info->height * info->window > limit) {
        return nacre_fail(error,
                          "%s: cannot write a scan of %d x %d surface points with a window of %d: "
                          "one image may have %lld pixels a side; make the window smaller",
                          path, info->width, info->height, info->window, (long long)limit);
    }
    return NACRE_OK;
}

static exr_result_t declare(exr_context_t context, const struct nacre_scan_info *info)
{
    int index = 0;
    int32_t width = info->width * info->window;
    int32_t height = info->height * info->window;
    exr_attr_box2i_t box = {.max = {.x = width - 1, .y = height - 1}};
    exr_attr_v2f_t centre = {.x = 0, .y = 0};
    exr_result_t result = exr_add_part(context, NULL, EXR_STORAGE_TILED, &index);
    if (result == EXR_ERR_SUCCESS) {
        result = exr_initialize_required_attr(
            context, 0, &box, &box, 1, &centre, 1, EXR_LINEORDER_RANDOM_Y,
            info->compress ? EXR_COMPRESSION_ZIP : EXR_COMPRESSION_NONE);
    }
    if (result == EXR_ERR_SUCCESS) {
        result = exr_set_tile_descriptor(context, 0, (uint32_t)info->window, (uint32_t)info->window,
                                         EXR_TILE_ONE_LEVEL, EXR_TILE_ROUND_DOWN);
    }
    for (int c = 0; c < info->channels && result == EXR_ERR_SUCCESS; c++) {
        result = exr_add_channel(context, 0, channel_name(info->channels, c),
                                 info->pixel == NACRE_HALF ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT,
                                 EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
    }
    if (result == EXR_ERR_SUCCESS) {
        result = exr_attr_set_string(context, 0, "nacre.format", "scan 1");
    }
    if (result == EXR_ERR_SUCCESS) {
        result = exr_attr_set_float(context, 0, "nacre.pitch", (float)info->pitch_mm);
    }
    if (result == EXR_ERR_SUCCESS) {
        result = exr_attr_set_int(context, 0, "nacre.window", info->window);
    }
    if (result == EXR_ERR_SUCCESS) {
        result = exr_attr_set_string(context, 0, "nacre.source", info->source);
    }
    return result == EXR_ERR_SUCCESS ? exr_write_header(context) : result;
}

int nacre_scan_create(const char *path, const struct nacre_scan_info *info,
                      struct nacre_scan_writer **writer, struct nacre_error *error)
{
    *writer = NULL;
    int status = check_info(path, info, error);
    if (status != NACRE_OK) {
        return status;
    }
    struct nacre_scan_writer *made = calloc(1, sizeof *made);
    if (!made) {
        return nacre_fail_memory(error, path);
    }
    made->info = *info;
    made->info.source[sizeof made->info.source - 1] = '\0';
    made->path = strdup(path);
    made->capacity = info->compress ? BATCH : 1;
    bool allocated = true;
    for (int i = 0; i < made->capacity; i++) {
        made->tiles[i].response = calloc(nacre_scan_response_size(info), sizeof(float));
        allocated = allocated && made->tiles[i].response;
    }
    made->written = calloc((size_t)info->width * (size_t)info->height, sizeof *made->written);
    if (!made->path || !allocated || !made->written) {
        status = nacre_fail_memory(error, path);
        goto out;
    }
    status = whole_file_create(&made->whole, path, error);
    if (status == NACRE_OK) {
        status = exr_stream_create(&made->stream, made->whole.temporary, path, error);
    }
    if (status == NACRE_OK) {
        exr_result_t result = declare(made->stream.context, &made->info);
        if (result != EXR_ERR_SUCCESS) {
            status = exr_stream_fail(&made->stream, result, error, "cannot write its header");
        }
    }
out:
    if (status == NACRE_OK) {
        *writer = made;
    } else {
        nacre_scan_discard(made);
    }
    return status;
}

/* Pack and compress one tile, without writing it. Several threads do so with different tiles. */
static exr_result_t encode(struct nacre_scan_writer *writer, struct tile *tile)
{
    exr_context_t context = writer->stream.context;
    exr_encode_pipeline_t *pipeline = &tile->pipeline;
    exr_chunk_info_t chunk;
    exr_result_t result = exr_write_tile_chunk_info(context, 0, tile->x, tile->y, 0, 0, &chunk);
    if (result == EXR_ERR_SUCCESS) {
        result = tile->ready ? exr_encoding_update(context, 0, &chunk, pipeline)
                             : exr_encoding_initialize(context, 0, &chunk, pipeline);
    }
    if (result != EXR_ERR_SUCCESS) {
        return result;
    }
    size_t window = (size_t)writer->info.window;
    for (int c = 0; c < pipeline->channel_count; c++) {
        exr_coding_channel_info_t *channel = &pipeline->channels[c];
        /* never -1: the names are those that declare gave */
        size_t plane = (size_t)channel_find(writer->info.channels, channel->channel_name);
        channel->user_data_type = EXR_PIXEL_FLOAT;
        channel->user_bytes_per_element = sizeof(float);
        channel->user_pixel_stride = sizeof(float);
        channel->user_line_stride = writer->info.window * (int)sizeof(float);
        channel->encode_from_ptr = (const uint8_t *)(tile->response + plane * window * window);
    }
    if (!tile->ready) {
        tile->ready = true;
        result = exr_encoding_choose_default_routines(context, 0, pipeline);
        pipeline->yield_until_ready_fn = NULL;
        pipeline->write_fn = NULL;
    }
    if (result == EXR_ERR_SUCCESS) {
        result = exr_encoding_run(context, 0, pipeline);
    }
    if (result == EXR_ERR_SUCCESS) {
        exr_stream_settle(pipeline);
    }
    return result;
}

/* Compress the tiles that wait on all cores, then write them one after the other. */
static int flush(struct nacre_scan_writer *writer, struct nacre_error *error)
{
    int count = writer->count;
    writer->count = 0;
#pragma omp parallel for schedule(dynamic, 1) if (count > 1)
    for (int i = 0; i < count; i++) {
        writer->tiles[i].result = encode(writer, &writer->tiles[i]);
    }
    for (int i = 0; i < count; i++) {
        const struct tile *tile = &writer->tiles[i];
        exr_result_t result = tile->result;
        if (result == EXR_ERR_SUCCESS) {
            result = exr_write_tile_chunk(writer->stream.context, 0, tile->x, tile->y, 0, 0,
                                          tile->pipeline.compressed_buffer,
                                          tile->pipeline.compressed_bytes);
        }
        if (result != EXR_ERR_SUCCESS) {
            return exr_stream_fail(&writer->stream, result, error, "tile (%d, %d): cannot write",
                                   tile->x, tile->y);
        }
    }
    return NACRE_OK;
}

/* Queue the response of (x, y), or NaN where it is NULL. */
static int write_response(struct nacre_scan_writer *writer, int x, int y, const float *response,
                          struct nacre_error *error)
{
    struct tile *tile = &writer->tiles[writer->count++];
    size_t size = nacre_scan_response_size(&writer->info);
    tile->x = x;
    tile->y = y;
    for (size_t i = 0; i < size; i++) {
        tile->response[i] = response ? response[i] : NAN;
    }
    scan_window_clear_outside(&writer->info, x, y, tile->response);
    writer->written[(size_t)y * (size_t)writer->info.width + (size_t)x] = true;
    return writer->count == writer->capacity ? flush(writer, error) : NACRE_OK;
}

int nacre_scan_write(struct nacre_scan_writer *writer, int x, int y, const float *response,
                     struct nacre_error *error)
{
    const struct nacre_scan_info *info = &writer->info;
    if (x < 0 || y < 0 || x >= info->width || y >= info->height) {
        return nacre_fail(error, "%s: cannot write surface point (%d, %d); the scan has %d x %d",
                          writer->path, x, y, info->width, info->height);
    }
    if (writer->written[(size_t)y * (size_t)info->width + (size_t)x]) {
        return nacre_fail(error, "%s: surface point (%d, %d) was written already", writer->path, x,
                          y);
    }
    return write_response(writer, x, y, response, error);
}

/* OpenEXR frees a pipeline through its context, so before that is closed. */
static void finish_tiles(struct nacre_scan_writer *writer)
{
    for (int i = 0; i < BATCH; i++) {
        struct tile *tile = &writer->tiles[i];
        if (tile->ready) {
            (void)exr_encoding_destroy(writer->stream.context, &tile->pipeline);
        }
        tile->ready = false;
        free(tile->response);
        tile->response = NULL;
    }
}

int nacre_scan_commit(struct nacre_scan_writer *writer, struct nacre_error *error)
{
    int status = NACRE_OK;
    const struct nacre_scan_info *info = &writer->info;
    for (int y = 0; y < info->height; y++) {
        for (int x = 0; x < info->width && status == NACRE_OK; x++) {
            if (!writer->written[(size_t)y * (size_t)info->width + (size_t)x]) {
                status = write_response(writer, x, y, NULL, error);
            }
        }
    }
    if (status == NACRE_OK) {
        status = flush(writer, error);
    }
    if (status == NACRE_OK) {
        finish_tiles(writer);
        status = exr_stream_close(&writer->stream, error);
    }
    if (status == NACRE_OK) {
        status = whole_file_commit(&writer->whole, error);
    }
    nacre_scan_discard(writer);
    return status;
}

void nacre_scan_discard(struct nacre_scan_writer *writer)
{
    if (!writer) {
        return;
    }
    finish_tiles(writer);
    exr_stream_finish(&writer->stream);
    whole_file_discard(&writer->whole);
    free(writer->path);
    free(writer->written);
    free(writer);
}
