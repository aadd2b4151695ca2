/* Telling a cut-off file from a whole one by its chunk table, which OpenEXR's API does not show. */
#include "exr_stream.h"

#include <endian.h>
#include <string.h>
#include <unistd.h>

enum { MAGIC_AND_VERSION = 8, NAME_LIMIT = 256, LEADER = 20, BLOCK = 512 };

static bool read_at(const struct exr_stream *stream, void *buffer, size_t size, uint64_t offset)
{
    return pread(stream->descriptor, buffer, size, (off_t)offset) == (ssize_t)size;
}

/* Where the attributes of the only header end: each is NAME \0 TYPE \0 SIZE VALUE, and an empty name is the last.
 * 0 where it is cut off. */
static uint64_t header_end(const struct exr_stream *stream)
{
    uint64_t offset = MAGIC_AND_VERSION;
    for (;;) {
        char bytes[2 * NAME_LIMIT + sizeof(uint32_t)] = {0};
        ssize_t got = pread(stream->descriptor, bytes, sizeof bytes, (off_t)offset);
        if (got < 1) {
            return 0;
        }
        if (bytes[0] == '\0') {
            return offset + 1;
        }
        size_t name = strnlen(bytes, NAME_LIMIT - 1) + 1;
        size_t type = strnlen(bytes + name, NAME_LIMIT - 1) + 1;
        uint32_t size = 0;
        if ((size_t)got < name + type + sizeof size) {
            return 0;
        }
        memcpy(&size, bytes + name + type, sizeof size);
        offset += name + type + sizeof size + le32toh(size);
    }
}

bool exr_stream_complete(const struct exr_stream *stream, uint64_t tiles)
{
    uint64_t size = (uint64_t)stream->size;
    uint64_t table = header_end(stream);
    uint64_t last = 0;
    uint64_t offsets[BLOCK];
    if (table == 0 || table > size || tiles > (size - table) / sizeof offsets[0]) {
        return false;
    }
    uint64_t first = table + tiles * sizeof offsets[0];
    for (uint64_t done = 0; done < tiles;) {
        uint64_t count = tiles - done < BLOCK ? tiles - done : BLOCK;
        if (!read_at(stream, offsets, count * sizeof offsets[0],
                     table + done * sizeof offsets[0])) {
            return false;
        }
        for (uint64_t i = 0; i < count; i++) {
            uint64_t offset = le64toh(offsets[i]);
            if (offset < first || offset > size - LEADER) {
                return false;
            }
            last = offset > last ? offset : last;
        }
        done += count;
    }
    /* The tile that stands last in the file must be there to its last byte; its size ends its leader. */
    uint32_t packed = 0;
    return tiles > 0 && read_at(stream, &packed, sizeof packed, last + LEADER - sizeof packed) &&
           le32toh(packed) <= size - LEADER - last;
}
