/* OpenEXR contexts that keep their errors. */
#include "exr_stream.h"

#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static int64_t read_bytes(exr_const_context_t context, void *user, void *buffer, uint64_t size,
                          uint64_t offset, exr_stream_error_func_ptr_t fail)
{
    (void)context;
    (void)fail;
    struct exr_stream *stream = user;
    char *bytes = buffer;
    uint64_t done = 0;
    while (done < size) {
        ssize_t got = pread(stream->descriptor, bytes + done, size - done, (off_t)(offset + done));
        if (got > 0) {
            done += (uint64_t)got;
        } else if (got == 0) {
            break;
        } else if (errno != EINTR) {
            stream->number = errno;
            return -1;
        }
    }
    return (int64_t)done;
}

static int64_t write_bytes(exr_const_context_t context, void *user, const void *buffer,
                           uint64_t size, uint64_t offset, exr_stream_error_func_ptr_t fail)
{
    (void)context;
    (void)fail;
    struct exr_stream *stream = user;
    const char *bytes = buffer;
    uint64_t done = 0;
    while (done < size) {
        ssize_t put = pwrite(stream->descriptor, bytes + done, size - done, (off_t)(offset + done));
        if (put > 0) {
            done += (uint64_t)put;
        } else if (put == 0 || errno != EINTR) {
            stream->number = put == 0 ? ENOSPC : errno;
            return -1;
        }
    }
    return (int64_t)done;
}

static int64_t file_size(exr_const_context_t context, void *user)
{
    (void)context;
    return ((struct exr_stream *)user)->size;
}

/* While a header is being made OpenEXR reports with its lock held, so that nothing may be asked of
 * the context; the result code and the errno of the transfer tell enough. */
static void ignore_message(exr_const_context_t context, exr_result_t code, const char *message)
{
    (void)context;
    (void)code;
    (void)message;
}

static void keep_message(exr_const_context_t context, exr_result_t code, const char *message)
{
    void *user = NULL;
    (void)code;
    if (context && exr_get_user_data(context, &user) == EXR_ERR_SUCCESS && user) {
        struct exr_stream *stream = user;
        (void)snprintf(stream->message, sizeof stream->message, "%s", message);
        for (char *c = stream->message; *c; c++) {
            if ((unsigned char)*c < ' ' || *c == 127) {
                *c = ' ';
            }
        }
    }
}

int exr_stream_fail(const struct exr_stream *stream, exr_result_t result, struct nacre_error *error,
                    const char *format, ...)
{
    char what[512];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(what, sizeof what, format, arguments);
    va_end(arguments);
    if (stream->number != 0) {
        return nacre_fail_errno(error, stream->number, "%s: %s", stream->path, what);
    }
    const char *cause =
        stream->message[0] ? stream->message : exr_get_default_error_message(result);
    return nacre_fail(error, "%s: %s: %s", stream->path, what, cause);
}

static exr_context_initializer_t reading(struct exr_stream *stream)
{
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.error_handler_fn = keep_message;
    setup.user_data = stream;
    setup.read_fn = read_bytes;
    setup.size_fn = file_size;
    setup.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    return setup;
}

/* Refuse by the first bytes what OpenEXR would refuse with less plain words. */
static int check_magic(const struct exr_stream *stream, struct nacre_error *error)
{
    static const unsigned char magic[4] = {0x76, 0x2f, 0x31, 0x01};
    unsigned char bytes[4];
    if (stream->size == 0) {
        return nacre_fail(error, "%s: not an OpenEXR file: it is empty", stream->path);
    }
    ssize_t got = pread(stream->descriptor, bytes, sizeof bytes, 0);
    if (got < 0) {
        return nacre_fail_errno(error, errno, "%s: cannot read", stream->path);
    }
    if (got != (ssize_t)sizeof bytes || memcmp(bytes, magic, sizeof bytes) != 0) {
        return nacre_fail(error, "%s: not an OpenEXR file: it begins with other bytes",
                          stream->path);
    }
    return NACRE_OK;
}

static int start_reading(struct exr_stream *stream, struct nacre_error *error)
{
    exr_context_initializer_t setup = reading(stream);
    exr_result_t result = exr_start_read(&stream->context, stream->path, &setup);
    if (result != EXR_ERR_SUCCESS) {
        stream->context = NULL;
        return exr_stream_fail(stream, result, error,
                               "the OpenEXR header is damaged or incomplete");
    }
    return NACRE_OK;
}

int exr_stream_open(struct exr_stream *stream, const char *path, struct nacre_error *error)
{
    *stream = (struct exr_stream){0};
    (void)snprintf(stream->path, sizeof stream->path, "%s", path);
    struct stat status;
    /* Without O_NONBLOCK a named pipe would keep us waiting. */
    stream->descriptor = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (stream->descriptor < 0) {
        return nacre_fail_errno(error, errno, "%s: cannot open", path);
    }
    stream->open = true;
    int result = NACRE_OK;
    if (fstat(stream->descriptor, &status) != 0) {
        result = nacre_fail_errno(error, errno, "%s: cannot open", path);
    } else if (!S_ISREG(status.st_mode)) {
        result = nacre_fail(error, "%s: cannot open: not a plain file", path);
    } else {
        stream->size = status.st_size;
        result = check_magic(stream, error);
    }
    if (result == NACRE_OK) {
        result = start_reading(stream, error);
    }
    if (result != NACRE_OK) {
        exr_stream_finish(stream);
    }
    return result;
}

int exr_stream_share(struct exr_stream *stream, const struct exr_stream *other,
                     struct nacre_error *error)
{
    *stream = (struct exr_stream){
        .descriptor = other->descriptor, .open = true, .borrowed = true, .size = other->size};
    memcpy(stream->path, other->path, sizeof stream->path);
    int status = start_reading(stream, error);
    if (status != NACRE_OK) {
        exr_stream_finish(stream);
    }
    return status;
}

int exr_stream_create(struct exr_stream *stream, const char *temporary, const char *path,
                      struct nacre_error *error)
{
    *stream = (struct exr_stream){0};
    (void)snprintf(stream->path, sizeof stream->path, "%s", path);
    stream->descriptor = open(temporary, O_WRONLY | O_CLOEXEC);
    if (stream->descriptor < 0) {
        return nacre_fail_errno(error, errno, "%s: cannot write", path);
    }
    stream->open = true;
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.error_handler_fn = ignore_message;
    setup.user_data = stream;
    setup.write_fn = write_bytes;
    exr_result_t result =
        exr_start_write(&stream->context, stream->path, EXR_WRITE_FILE_DIRECTLY, &setup);
    if (result != EXR_ERR_SUCCESS) {
        stream->context = NULL;
        int status = exr_stream_fail(stream, result, error, "cannot write");
        exr_stream_finish(stream);
        return status;
    }
    return NACRE_OK;
}

int exr_stream_close(struct exr_stream *stream, struct nacre_error *error)
{
    int status = NACRE_OK;
    exr_result_t result = exr_finish(&stream->context);
    if (result != EXR_ERR_SUCCESS || stream->number != 0) {
        status = exr_stream_fail(stream, result, error, "cannot write");
    }
    if (!stream->borrowed && close(stream->descriptor) != 0 && status == NACRE_OK) {
        status = nacre_fail_errno(error, errno, "%s: cannot write", stream->path);
    }
    stream->open = false;
    return status;
}

void exr_stream_finish(struct exr_stream *stream)
{
    if (!stream) {
        return;
    }
    if (stream->context) {
        (void)exr_finish(&stream->context); /* the stream was given up */
    }
    if (stream->open && !stream->borrowed) {
        (void)close(stream->descriptor);
    }
    stream->open = false;
}

void exr_stream_settle(exr_encode_pipeline_t *encode)
{
    if (encode->compressed_bytes == encode->packed_bytes &&
        encode->compressed_buffer != encode->packed_buffer) {
        memcpy(encode->compressed_buffer, encode->packed_buffer, encode->packed_bytes);
    }
}

uint64_t exr_stream_plausible(int64_t size, exr_compression_t compression)
{
    uint64_t bytes = size > 0 ? (uint64_t)size : 0;
    uint64_t ratio = 1;
    switch (compression) {
    case EXR_COMPRESSION_NONE:
        break;
    case EXR_COMPRESSION_RLE:
    case EXR_COMPRESSION_ZIPS:
    case EXR_COMPRESSION_ZIP:
    case EXR_COMPRESSION_PIZ:
    case EXR_COMPRESSION_PXR24:
        ratio = 2200; /* deflate ends at 1032; PXR24 drops a quarter of each float before */
        break;
    default:
        ratio = 100000; /* lossy: a constant picture leaves little more than the chunk headers */
        break;
    }
    return bytes > UINT64_MAX / ratio ? UINT64_MAX : bytes * ratio;
}
