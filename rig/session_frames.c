/* Pattern files of a session: one part an exposure. */
#include "rig/session.h"

#include "nacre/exr_file.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int64_t session_exposure_ns(const struct session *session, size_t index)
{
    return llround(session->plan.exposure_turns[index] * 1e9 / session->station.projector.wheel_hz);
}

/* EXR's integers have 32 bits, too few for nanoseconds: those are strings of decimal digits. */
static int add_long(struct exr_part *part, const char *name, int64_t value)
{
    char text[32];
    (void)snprintf(text, sizeof text, "%" PRId64, value);
    return exr_part_add_string(part, name, text);
}

static int add_exposure_attributes(struct exr_part *part, const struct pattern_frames *frames,
                                   const struct exposure *exposure)
{
    const struct {
        const char *name;
        int64_t value;
    } times[] = {{"nacre.exposure_ns", exposure->exposure_ns},
                 {"nacre.flip_ns", exposure->flip_ns},
                 {"nacre.trigger_ns", exposure->trigger_ns},
                 {"nacre.frame_ns", exposure->frame_ns},
                 {"nacre.sequence", exposure->sequence}};
    for (size_t i = 0; i < sizeof times / sizeof *times; i++) {
        if (add_long(part, times[i].name, times[i].value) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    if (exposure->pulse_ns > 0 &&
        (add_long(part, "nacre.pulse_ns", exposure->pulse_ns) != NACRE_OK ||
         add_long(part, "nacre.pulse_doubt_ns", exposure->pulse_doubt_ns) != NACRE_OK)) {
        return NACRE_FAILED;
    }
    if (exr_part_add_string(part, "nacre.bayer", bayer_names[frames->bayer]) != NACRE_OK) {
        return NACRE_FAILED;
    }
    return exr_part_add_int(part, "nacre.bits", frames->bits);
}

static int add_file_attributes(struct exr_part *part, const struct session *session,
                               const struct pattern_frames *frames)
{
    if (exr_part_add_string(part, "nacre.format", "frames 1") != NACRE_OK ||
        exr_part_add_string(part, "nacre.pattern.kind", pattern_kind_names[frames->pattern.kind]) !=
            NACRE_OK ||
        exr_part_add_int(part, "nacre.pattern.number", frames->pattern.number) != NACRE_OK) {
        return NACRE_FAILED;
    }
    if (session->id[0] && exr_part_add_string(part, "nacre.session", session->id) != NACRE_OK) {
        return NACRE_FAILED;
    }
    if (frames->origin &&
        exr_part_add_string(part, "nacre.calibration", frames->origin) != NACRE_OK) {
        return NACRE_FAILED;
    }
    return exr_part_add_int(part, "nacre.seed", frames->seed);
}

static int add_exposure(struct exr_file *file, const struct session *session,
                        const struct pattern_frames *frames, size_t index)
{
    const struct exposure *exposure = &frames->exposures[index];
    size_t pixels = (size_t)frames->width * (size_t)frames->height;
    char name[64];
    (void)snprintf(name, sizeof name, "%" PRId64 "ns", exposure->exposure_ns);
    struct exr_part *part = exr_file_add_part(file, name, frames->width, frames->height);
    struct exr_plane *plane = part ? exr_part_add_plane(part, "raw", NACRE_UINT) : NULL;
    if (!plane) {
        return NACRE_FAILED;
    }
    for (size_t i = 0; i < pixels; i++) {
        plane->integers[i] = exposure->raw[i];
    }
    if (index == 0 && add_file_attributes(part, session, frames) != NACRE_OK) {
        return NACRE_FAILED;
    }
    return add_exposure_attributes(part, frames, exposure);
}

int session_write(const struct session *session, const struct pattern_frames *frames,
                  struct nacre_error *error)
{
    int status = NACRE_OK;
    struct exr_file file = {0};
    char *path = session_pattern_path(session, frames->pattern);
    if (!path) {
        status = nacre_fail_memory(error, "a path");
        goto out;
    }
    for (size_t i = 0; i < frames->count; i++) {
        if (add_exposure(&file, session, frames, i) != NACRE_OK) {
            status = nacre_fail_memory(error, path);
            goto out;
        }
    }
    status = exr_file_write(path, &file, EXR_ZIP_FAST, error);
out:
    exr_file_finish(&file);
    free(path);
    return status;
}

static int read_long(const struct exr_part *part, const char *name, int64_t *value,
                     struct nacre_error *error)
{
    const struct exr_attribute *attribute = exr_part_find(part, name, EXR_STRING);
    char *end = NULL;
    if (!attribute) {
        return nacre_fail(error, "part %s: lacks the attribute %s", part->name, name);
    }
    errno = 0;
    *value = strtoll(attribute->string, &end, 10);
    if (errno != 0 || end == attribute->string || *end != '\0') {
        return nacre_fail(error, "part %s: %s is no whole number", part->name, name);
    }
    return NACRE_OK;
}

static int check_file(const struct session *session, struct pattern pattern,
                      const struct exr_file *file, struct nacre_error *error)
{
    const struct exr_part *first = &file->parts[0];
    const struct exr_attribute *format = exr_part_find(first, "nacre.format", EXR_STRING);
    const struct exr_attribute *kind = exr_part_find(first, "nacre.pattern.kind", EXR_STRING);
    const struct exr_attribute *number = exr_part_find(first, "nacre.pattern.number", EXR_INT);
    const struct exr_attribute *seed = exr_part_find(first, "nacre.seed", EXR_INT);
    if (!format || strcmp(format->string, "frames 1") != 0) {
        return nacre_fail(error, "is no frame file of nacre (nacre.format is not \"frames 1\")");
    }
    if (!kind || !number || !seed) {
        return nacre_fail(error, "lacks the attributes of its pattern");
    }
    if (strcmp(kind->string, pattern_kind_names[pattern.kind]) != 0 ||
        number->integer != pattern.number) {
        return nacre_fail(error, "shows pattern %s %d; remove the file and resume the scan",
                          kind->string, number->integer);
    }
    if (seed->integer != session->plan.seed) {
        return nacre_fail(error,
                          "belongs to another session: its plan's seed is %d, not %d; remove the "
                          "file and resume the scan",
                          seed->integer, session->plan.seed);
    }
    size_t exposures = plan_pattern_exposures(&session->plan, pattern);
    if (file->part_count != exposures) {
        return nacre_fail(error, "has %zu exposures where the plan has %zu", file->part_count,
                          exposures);
    }
    return NACRE_OK;
}

/* Frames of a session that was begun without an id have none. */
static int check_id(const struct session *session, const struct exr_part *first,
                    struct nacre_error *error)
{
    const struct exr_attribute *id = exr_part_find(first, "nacre.session", EXR_STRING);
    const char *found = id ? id->string : "";
    return strcmp(found, session->id) == 0
               ? NACRE_OK
               : nacre_fail(error,
                            "belongs to another session: its nacre.session is '%.40s', not '%s'; "
                            "remove the file and resume the scan",
                            found, session->id);
}

/* Size, bits and Bayer order against the station. */
static int check_part(const struct station *station, const struct exr_part *part,
                      struct nacre_error *error)
{
    const struct station_camera *camera = &station->camera;
    const struct exr_attribute *bits = exr_part_find(part, "nacre.bits", EXR_INT);
    const struct exr_attribute *bayer = exr_part_find(part, "nacre.bayer", EXR_STRING);
    if (part->width != camera->width || part->height != camera->height) {
        return nacre_fail(error, "part %s: is %d x %d where the station's frames are %d x %d",
                          part->name, part->width, part->height, camera->width, camera->height);
    }
    if (!bits || !bayer) {
        return nacre_fail(error, "part %s: lacks nacre.bits or nacre.bayer", part->name);
    }
    if (bits->integer != camera->bits) {
        return nacre_fail(error, "part %s: has %d bits where the station's camera has %d",
                          part->name, bits->integer, camera->bits);
    }
    if (strcmp(bayer->string, bayer_names[camera->bayer]) != 0) {
        return nacre_fail(error, "part %s: has Bayer order %s where the station's camera has %s",
                          part->name, bayer->string, bayer_names[camera->bayer]);
    }
    return NACRE_OK;
}

static int read_times(const struct exr_part *part, struct exposure *exposure,
                      struct nacre_error *error)
{
    int64_t sequence = 0;
    const struct {
        const char *name;
        int64_t *value;
    } times[] = {{"nacre.exposure_ns", &exposure->exposure_ns},
                 {"nacre.flip_ns", &exposure->flip_ns},
                 {"nacre.trigger_ns", &exposure->trigger_ns},
                 {"nacre.frame_ns", &exposure->frame_ns},
                 {"nacre.sequence", &sequence}};
    for (size_t i = 0; i < sizeof times / sizeof *times; i++) {
        if (read_long(part, times[i].name, times[i].value, error) != NACRE_OK) {
            return NACRE_FAILED;
        }
    }
    if (sequence < 0 || sequence > UINT32_MAX) {
        return nacre_fail(error, "part %s: nacre.sequence is no frame number", part->name);
    }
    exposure->sequence = (uint32_t)sequence;
    if (exr_part_find(part, "nacre.pulse_ns", EXR_STRING) &&
        (read_long(part, "nacre.pulse_ns", &exposure->pulse_ns, error) != NACRE_OK ||
         read_long(part, "nacre.pulse_doubt_ns", &exposure->pulse_doubt_ns, error) != NACRE_OK)) {
        return NACRE_FAILED;
    }
    return NACRE_OK;
}

static int read_exposure(const struct session *session, const struct exr_part *part, size_t index,
                         struct exposure *exposure, struct nacre_error *error)
{
    const struct exr_plane *plane = exr_part_find_plane(part, "raw");
    size_t pixels = (size_t)part->width * (size_t)part->height;
    uint32_t top = (1u << session->station.camera.bits) - 1;
    uint32_t largest = 0;
    if (!plane || plane->pixel != NACRE_UINT) {
        return nacre_fail(error, "part %s: lacks the UINT channel raw", part->name);
    }
    if (check_part(&session->station, part, error) != NACRE_OK ||
        read_times(part, exposure, error) != NACRE_OK) {
        return NACRE_FAILED;
    }
    if (exposure->exposure_ns != session_exposure_ns(session, index)) {
        return nacre_fail(error,
                          "part %s: was exposed for %" PRId64 " ns where the plan has %" PRId64,
                          part->name, exposure->exposure_ns, session_exposure_ns(session, index));
    }
    exposure->raw = malloc(pixels * sizeof *exposure->raw);
    if (!exposure->raw) {
        return nacre_fail_memory(error, "a raw frame");
    }
    for (size_t i = 0; i < pixels; i++) {
        largest = plane->integers[i] > largest ? plane->integers[i] : largest;
        exposure->raw[i] = (uint16_t)plane->integers[i];
    }
    return largest > top ? nacre_fail(error, "part %s: holds %u, above saturation at %u",
                                      part->name, largest, top)
                         : NACRE_OK;
}

static int fill_frames(const struct session *session, struct pattern pattern,
                       const struct exr_file *file, struct pattern_frames *frames,
                       struct nacre_error *error)
{
    int status = check_file(session, pattern, file, error);
    if (status != NACRE_OK) {
        return status;
    }
    *frames = (struct pattern_frames){.pattern = pattern,
                                      .width = session->station.camera.width,
                                      .height = session->station.camera.height,
                                      .bits = session->station.camera.bits,
                                      .bayer = (enum bayer)session->station.camera.bayer,
                                      .seed = session->plan.seed};
    frames->exposures = calloc(file->part_count, sizeof *frames->exposures);
    if (!frames->exposures) {
        return nacre_fail_memory(error, "exposures");
    }
    frames->count = file->part_count;
    for (size_t i = 0; i < frames->count && status == NACRE_OK; i++) {
        status = read_exposure(session, &file->parts[i], i, &frames->exposures[i], error);
    }
    return status == NACRE_OK ? check_id(session, &file->parts[0], error) : status;
}

int session_read(const struct session *session, struct pattern pattern,
                 struct pattern_frames *frames, struct nacre_error *error)
{
    struct exr_file file = {0};
    char *path = session_pattern_path(session, pattern);
    int status;
    *frames = (struct pattern_frames){0};
    if (!path) {
        status = nacre_fail_memory(error, "a path");
        goto out;
    }
    status = exr_file_read(path, &file, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = fill_frames(session, pattern, &file, frames, error);
    if (status != NACRE_OK) {
        status = nacre_fail_within(error, "%s", path);
    }
out:
    if (status != NACRE_OK) {
        pattern_frames_finish(frames);
    }
    exr_file_finish(&file);
    free(path);
    return status;
}

void pattern_frames_finish(struct pattern_frames *frames)
{
    if (!frames) {
        return;
    }
    for (size_t i = 0; i < frames->count; i++) {
        free(frames->exposures[i].raw);
    }
    free(frames->exposures);
    *frames = (struct pattern_frames){0};
}
