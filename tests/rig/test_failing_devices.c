/* Tests of scans whose devices fail for good and come back, and of what a kill costs. */
#include "rig/sequence.h"

#include "stage.h"
#include "unity.h"

#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

/* A device in front of another that works for `calls` calls and then fails at each. */
struct failing_camera {
    struct camera base;
    struct camera *inner;
    int calls;
};

struct failing_projector {
    struct projector base;
    struct projector *inner;
    int calls;
    int patterns; /* that stay on the glass until they are asked for */
};

struct failing_trigger {
    struct trigger base;
    struct trigger *inner;
    int calls;
};

enum device { CAMERA, PROJECTOR, TRIGGER, LIGHT };
static const char *const complaints[] = {
    "camera faulty: was unplugged", "projector faulty: shows nothing",
    "trigger faulty: its board is gone", "projector faulty: went dark"};
enum { ENDLESS = 1 << 30 };

/* Of the writer: patterns that wait in its queue, that are being written, and the one that is being measured. */
enum { QUEUED = 4, WRITTEN = 2, MEASURED = 1 };

static struct nacre_error error;
static struct stage stage;
static struct session session;
static struct operator_log log_;
static struct sequence_result result;

void setUp(void)
{
    error.text[0] = '\0';
    log_ = (struct operator_log){0};
    stage_begin(&stage, NULL, &session);
}

void tearDown(void)
{
    session_finish(&session);
    stage_remove(&stage);
}

static int arm(struct camera *camera, int64_t exposure_ns, struct nacre_error *failure)
{
    struct failing_camera *own = (struct failing_camera *)camera;
    return own->calls-- > 0 ? own->inner->ops->arm(own->inner, exposure_ns, failure)
                            : nacre_fail(failure, "%s", complaints[CAMERA]);
}

static int take(struct camera *camera, int64_t timeout_ns, struct camera_frame *frame,
                struct nacre_error *failure)
{
    struct failing_camera *own = (struct failing_camera *)camera;
    return own->calls-- > 0 ? own->inner->ops->take(own->inner, timeout_ns, frame, failure)
                            : nacre_fail(failure, "%s", complaints[CAMERA]);
}

static int show(struct projector *projector, const uint8_t *levels, int64_t *flip_ns,
                struct nacre_error *failure)
{
    struct failing_projector *own = (struct failing_projector *)projector;
    return own->calls-- > 0 ? own->inner->ops->show(own->inner, levels, flip_ns, failure)
                            : nacre_fail(failure, "%s", complaints[PROJECTOR]);
}

static int confirm(struct projector *projector, struct nacre_error *failure)
{
    struct failing_projector *own = (struct failing_projector *)projector;
    return own->patterns-- > 0 ? NACRE_OK : nacre_fail(failure, "%s", complaints[LIGHT]);
}

static int fire(struct trigger *trigger, int64_t exposure_ns, int64_t *trigger_ns,
                struct nacre_error *failure)
{
    struct failing_trigger *own = (struct failing_trigger *)trigger;
    return own->calls-- > 0 ? own->inner->ops->fire(own->inner, exposure_ns, trigger_ns, failure)
                            : nacre_fail(failure, "%s", complaints[TRIGGER]);
}

/* Measure what the session lacks with a device that fails after `calls` calls. */
static int scan(enum device device, int calls, int retries, const struct sequence_operator *person)
{
    static const struct camera_ops camera_ops = {.name = "faulty", .arm = arm, .take = take};
    static const struct projector_ops projector_ops = {
        .name = "faulty", .show = show, .confirm = confirm};
    static const struct trigger_ops trigger_ops = {.name = "faulty", .fire = fire};
    const struct sequence_options options = {.retries = retries, .tolerance_ns = 2000000};
    struct virtual_station *station = NULL;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, virtual_station_new(&session.station, &station, &error),
                                  error.text);
    struct failing_camera camera = {*virtual_station_camera(station),
                                    virtual_station_camera(station),
                                    device == CAMERA ? calls : ENDLESS};
    struct failing_projector projector = {
        *virtual_station_projector(station), virtual_station_projector(station),
        device == PROJECTOR ? calls : ENDLESS, device == LIGHT ? calls : ENDLESS};
    struct failing_trigger trigger = {*virtual_station_trigger(station),
                                      virtual_station_trigger(station),
                                      device == TRIGGER ? calls : ENDLESS};
    camera.base.ops = &camera_ops;
    projector.base.ops = &projector_ops;
    trigger.base.ops = &trigger_ops;
    struct devices devices = {&camera.base, &projector.base, &trigger.base,
                              virtual_station_clock(station)};
    log_.station = station;
    int status = sequence_run(&devices, &session, person, &options, NULL, &result, &error);
    virtual_station_free(station);
    return status;
}

static int white_layer(void *context, bool on, struct nacre_error *failure)
{
    (void)context;
    (void)failure;
    virtual_station_set_white_layer(log_.station, on);
    return NACRE_OK;
}

static int pattern_begins(void *context, const struct sequence_moment *moment,
                          struct nacre_error *failure)
{
    (void)context;
    (void)failure;
    virtual_station_begin_pattern(log_.station, moment->pattern);
    return NACRE_OK;
}

static const struct sequence_operator person = {.white_layer = white_layer,
                                                .pattern_begins = pattern_begins};

static void resume(void)
{
    session_finish(&session);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, session_create(stage.session, stage.station, NULL, true, &session, &error),
        error.text);
}

static int count_patterns(void)
{
    static const char *const folders[] = {"calibration", "frames"};
    int count = 0;
    for (int i = 0; i < 2; i++) {
        char path[160];
        (void)snprintf(path, sizeof path, "%s/%s", stage.session, folders[i]);
        DIR *listing = opendir(path);
        for (struct dirent *entry = listing ? readdir(listing) : NULL; entry;
             entry = readdir(listing)) {
            count += entry->d_name[0] != '.';
        }
        if (listing) {
            (void)closedir(listing);
        }
    }
    return count;
}

/* A hash of every raw value; all patterns must be there, and whole. */
static uint64_t hash_frames(void)
{
    uint64_t hash = 14695981039346656037u; /* FNV-1a */
    struct pattern *patterns;
    size_t count;
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, count_patterns());
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&session.plan, &patterns, &count, &error));
    for (size_t i = 0; i < count; i++) {
        struct pattern_frames frames;
        TEST_ASSERT_EQUAL_INT_MESSAGE(
            NACRE_OK, session_read(&session, patterns[i], &frames, &error), error.text);
        for (size_t k = 0; k < frames.count; k++) {
            for (int p = 0; p < frames.width * frames.height; p++) {
                hash = (hash ^ frames.exposures[k].raw[p]) * 1099511628211u;
            }
        }
        pattern_frames_finish(&frames);
    }
    free(patterns);
    return hash;
}

/* The hash of a scan that nothing disturbed, in a session that is then thrown away. */
static uint64_t undisturbed(void)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(CAMERA, ENDLESS, 0, &person), error.text);
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, result.patterns);
    uint64_t hash = hash_frames();
    tearDown();
    setUp();
    return hash;
}

/* What was exposed while the projector went dark is not kept. */
static void pattern_that_did_not_stay_on_the_glass_is_not_kept(void)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, scan(LIGHT, 3, 2, &person));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, complaints[LIGHT]), error.text);
    TEST_ASSERT_EQUAL_INT(3, count_patterns());
    resume();
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, scan(LIGHT, ENDLESS, 0, &person), error.text);
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS - 3, result.patterns);
}

/* The device fails at its first call, then later and later in the scan, until a scan comes to its end: each run goes on
 * with what the ones before it left. */
static void device_that_comes_back_loses_nothing(enum device device, int step)
{
    uint64_t expected = undisturbed();
    int stops = 0;
    int calls = 0;
    size_t kept = 0;
    while (scan(device, calls, 2, &person) != NACRE_OK) {
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, complaints[device]), error.text);
        TEST_ASSERT_EQUAL_INT(kept, result.skipped);
        kept += result.patterns;
        TEST_ASSERT_EQUAL_INT(kept, count_patterns());
        TEST_ASSERT_TRUE(++stops < 200);
        calls = stops % 4 * step;
        resume();
    }
    TEST_ASSERT_TRUE(stops >= STAGE_PATTERNS / 3);
    TEST_ASSERT_TRUE(hash_frames() == expected);
    printf("%s: %d stops, each resumed\n", complaints[device], stops);
}

static void camera_that_comes_back_loses_nothing(void)
{
    device_that_comes_back_loses_nothing(CAMERA, 3);
}

static void projector_that_comes_back_loses_nothing(void)
{
    device_that_comes_back_loses_nothing(PROJECTOR, 1);
}

static void trigger_that_comes_back_loses_nothing(void)
{
    device_that_comes_back_loses_nothing(TRIGGER, 1);
}

/* Shared with a scan in a process of its own: patterns that it has begun. */
static volatile sig_atomic_t *begun;

static int note(void *context, const struct sequence_moment *moment, struct nacre_error *failure)
{
    ++*begun;
    return pattern_begins(context, moment, failure);
}

/* A pattern begins when all but the last one before it are on the disk: a station whose writer keeps up, however slow the
 * machine. Where patterns are held back, none begins any more. */
static int note_in_step(void *context, const struct sequence_moment *moment,
                        struct nacre_error *failure)
{
    while (count_patterns() < *begun - 1) {
        (void)usleep(200);
    }
    return note(context, moment, failure);
}

/* Kill the scan once so many patterns have begun, and a moment later; how many it had begun that are not on the disk. */
static int lost_by_a_kill(const struct sequence_operator *noting, int patterns, int delay_us)
{
    int status;
    TEST_ASSERT_EQUAL_INT(0, count_patterns());
    *begun = 0;
    pid_t child = fork();
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        _exit(scan(CAMERA, ENDLESS, 0, noting) == NACRE_OK ? 0 : 1);
    }
    for (int waited_ms = 0; *begun < patterns && waited_ms < 20000; waited_ms++) {
        (void)usleep(1000);
    }
    (void)usleep((useconds_t)delay_us);
    (void)kill(child, SIGKILL);
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_TRUE(WIFSIGNALED(status) || WEXITSTATUS(status) == 0);
    TEST_ASSERT_TRUE_MESSAGE(*begun >= patterns, "patterns are held back from the disk");
    return (int)*begun - count_patterns();
}

/* Kills at moments spread over a scan; the most that one cost. */
static int worst_of_kills(int (*pattern_begins_noted)(void *, const struct sequence_moment *,
                                                      struct nacre_error *),
                          int kills)
{
    const struct sequence_operator noting = {.white_layer = white_layer,
                                             .pattern_begins = pattern_begins_noted};
    int worst = 0;
    begun = mmap(NULL, sizeof *begun, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_TRUE(begun != MAP_FAILED);
    for (int i = 0; i < kills; i++) {
        int lost = lost_by_a_kill(&noting, 1 + i % 10, 300 * i);
        worst = lost > worst ? lost : worst;
        tearDown();
        setUp();
    }
    (void)munmap((void *)(size_t)begun, sizeof *begun);
    return worst;
}

/* However slow the disk. */
static void kill_costs_no_more_than_the_writer_holds(void)
{
    int worst = worst_of_kills(note, 30);
    TEST_ASSERT_TRUE(worst > 0 && worst <= QUEUED + WRITTEN + MEASURED);
    printf("30 kills of scans at full speed: at most %d patterns begun and not yet on the disk\n",
           worst);
}

/* The one that is being measured and the last one before it. */
static void kill_costs_two_patterns_where_the_writer_keeps_up(void)
{
    int worst = worst_of_kills(note_in_step, 20);
    TEST_ASSERT_TRUE(worst > 0 && worst <= 2);
    printf("20 kills of scans in step with the disk: at most %d patterns begun and not yet on it\n",
           worst);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(pattern_that_did_not_stay_on_the_glass_is_not_kept);
    RUN_TEST(camera_that_comes_back_loses_nothing);
    RUN_TEST(projector_that_comes_back_loses_nothing);
    RUN_TEST(trigger_that_comes_back_loses_nothing);
    RUN_TEST(kill_costs_no_more_than_the_writer_holds);
    RUN_TEST(kill_costs_two_patterns_where_the_writer_keeps_up);
    return UNITY_END();
}
