/* Decompression of OpenEXR's ZIP and ZIPS chunks, faster than OpenEXRCore's own. */
#ifndef NACRE_EXR_UNZIP_H
#define NACRE_EXR_UNZIP_H

#include "exr_stream.h"

#include <openexr_decode.h>

/* Memory of the decompression of one file's chunks, one thread at a time. Zero-initialised it is empty;
 * exr_unzip_finish frees. */
struct exr_unzip {
    struct libdeflate_decompressor *inflate;
    uint8_t *bytes;
    size_t capacity;
};

/* Use it for the pipeline's chunks where they are ZIP or ZIPS. Call it after the default routines were chosen. `unzip`
 * must outlive the pipeline. */
void exr_unzip_use(struct exr_unzip *unzip, exr_decode_pipeline_t *decode);
void exr_unzip_finish(struct exr_unzip *unzip);

#endif
