/* Decompression of OpenEXR's ZIP and ZIPS chunks, faster than OpenEXRCore's own.
 *
 * A chunk is a zlib stream of differences: each byte is its predecessor plus itself less 128. Of the bytes so restored,
 * the first half are those that stand at even places, the second half those at odd ones. */
#include "exr_unzip.h"

#include <libdeflate.h>
#include <stdlib.h>

/* Both halves at once, as each is a chain of additions that must wait for each other: the second begins where the sum
 * over the first ends. */
static void restore(const uint8_t *restrict bytes, size_t count, uint8_t *restrict out)
{
    size_t odd = count / 2;
    size_t even = count - odd;
    unsigned sum = 0;
    for (size_t i = 0; i < even; i++) {
        sum += bytes[i];
    }
    /* The first byte is whole: 128 is taken off one time less than there are bytes. */
    uint8_t low = 128;
    uint8_t high = (uint8_t)(sum - 128 * (unsigned)(even - 1));
    for (size_t i = 0; i < odd; i++) {
        low = (uint8_t)(low + bytes[i] - 128);
        high = (uint8_t)(high + bytes[even + i] - 128);
        out[2 * i] = low;
        out[2 * i + 1] = high;
    }
    if (even > odd) {
        out[2 * odd] = (uint8_t)(low + bytes[odd] - 128);
    }
}

static exr_result_t unzip_chunk(exr_decode_pipeline_t *decode)
{
    struct exr_unzip *unzip = decode->decoding_user_data;
    size_t size = decode->chunk.unpacked_size;
    size_t written = 0;
    if (decode->chunk.packed_size == size || size == 0) {
        return EXR_ERR_SUCCESS; /* stored as it is; the pipeline takes it from where it lies */
    }
    if (!unzip->inflate) {
        unzip->inflate = libdeflate_alloc_decompressor();
    }
    if (size > unzip->capacity) {
        uint8_t *more = realloc(unzip->bytes, size);
        unzip->bytes = more ? more : unzip->bytes;
        unzip->capacity = more ? size : unzip->capacity;
    }
    if (!unzip->inflate || size > unzip->capacity) {
        return EXR_ERR_OUT_OF_MEMORY;
    }
    if (libdeflate_zlib_decompress(unzip->inflate, decode->packed_buffer, decode->chunk.packed_size,
                                   unzip->bytes, size, &written) != LIBDEFLATE_SUCCESS ||
        written != size) {
        return EXR_ERR_CORRUPT_CHUNK;
    }
    restore(unzip->bytes, size, decode->unpacked_buffer);
    return EXR_ERR_SUCCESS;
}

void exr_unzip_use(struct exr_unzip *unzip, exr_decode_pipeline_t *decode)
{
    exr_compression_t compression = (exr_compression_t)decode->chunk.compression;
    if (decode->decompress_fn &&
        (compression == EXR_COMPRESSION_ZIP || compression == EXR_COMPRESSION_ZIPS)) {
        decode->decoding_user_data = unzip;
        decode->decompress_fn = unzip_chunk;
    }
}

void exr_unzip_finish(struct exr_unzip *unzip)
{
    if (unzip->inflate) {
        libdeflate_free_decompressor(unzip->inflate);
    }
    free(unzip->bytes);
    *unzip = (struct exr_unzip){0};
}
