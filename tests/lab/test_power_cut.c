/* A scan whose machine loses its power: what was written is on the disk, and the scan is resumed. One argument tells which
 * boot this is: 1 to CUTS end with the power cut, the one after looks at what is left. */
#include "guest.h"
#include "nacre/whole_file.h"
#include "tests/cmd/frames.h"
#include "tests/cmd/spawn.h"
#include "unity.h"

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

/* A thread that writes patterns may have renamed one that it has not yet synced. */
enum { CUTS = 2, PATTERNS = 56, WRITERS = 2, CONTENT = 3000 };

/* What the disk must remember of the moment of the cut lies behind the file system, where it is written past the caches
 * and so without syncing anything else. */
enum { FILE_SYSTEM_MIB = 48, RECORD_BYTES = 4096 };

struct record {
    int boot;
    int visible;  /* patterns that had their names */
    int reported; /* files whose writing whole_file_write said was done */
};

static const char disk[] = "/dev/vda";
static const char session[] = "/mnt/session";
static const char settings[] = "/run/power";
static char *station;
static int boot;
static struct record record;

void setUp(void)
{
}

void tearDown(void)
{
}

/* Write it before the cut, and read it after. */
static void transfer_record(bool writing)
{
    void *bytes = aligned_alloc(RECORD_BYTES, RECORD_BYTES);
    int file = open(disk, (writing ? O_WRONLY : O_RDONLY) | O_DIRECT | O_CLOEXEC);
    off_t place = (off_t)FILE_SYSTEM_MIB << 20;
    TEST_ASSERT_TRUE(file >= 0 && bytes);
    memset(bytes, 0, RECORD_BYTES);
    memcpy(bytes, &record, sizeof record);
    TEST_ASSERT_EQUAL_INT(RECORD_BYTES, writing ? pwrite(file, bytes, RECORD_BYTES, place)
                                                : pread(file, bytes, RECORD_BYTES, place));
    memcpy(&record, bytes, sizeof record);
    (void)close(file);
    free(bytes);
}

static void make_content(int number, char *content)
{
    for (int i = 0; i < CONTENT; i++) {
        content[i] = (char)('a' + (number + i / 7) % 26);
    }
}

static void report_path(int round, int number, char *path, size_t size)
{
    (void)snprintf(path, size, "/mnt/reports/%d-%d", round, number);
}

/* Write file after file; `*reported` counts those that are said to be written. */
static pid_t start_reporting(volatile int *reported)
{
    (void)fflush(stdout);
    pid_t child = fork();
    TEST_ASSERT_TRUE(child >= 0);
    for (int i = 0; child == 0; i++) {
        char path[64];
        char content[CONTENT];
        struct nacre_error error;
        report_path(boot, i, path, sizeof path);
        make_content(i, content);
        if (whole_file_write(path, content, CONTENT, &error) != NACRE_OK) {
            _exit(1);
        }
        *reported = i + 1;
    }
    return child;
}

static pid_t start_scan(const char *path, bool resume)
{
    (void)fflush(stdout);
    pid_t child = fork();
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        (void)freopen("/dev/null", "w", stdout);
        (void)execl(NACRE, NACRE, "scan", path, "--station", station, "--quiet",
                    resume ? "--resume" : NULL, (char *)NULL);
        _exit(99);
    }
    return child;
}

static void write_settings(void)
{
    guest_run("mkdir -p %s", settings);
    station = path_join(settings, "station.yaml");
    char *plan = path_join(settings, "plan.yaml");
    text_write(
        plan,
        "{seed: 5, black_frames: 2, white_frames: 1, dot_spacing: 4, dot_shift: 2, dot_size: 1,\n"
        " grid_spacing: 7, window: 7, exposure_turns: [1, 8]}\n");
    text_write(
        station,
        "{sample: {width: 8, height: 8, pitch_mm: 0.5}, white_reflectance: 0.9, plan: plan.yaml,\n"
        " camera: {driver: virtual, width: 40, height: 40, bits: 10, bayer: RGGB, pedestal: 16,\n"
        "          read_noise: 0.5, electrons: 8},\n"
        " projector: {driver: virtual, wheel_hz: 30}, trigger: {driver: virtual},\n"
        " virtual: {seed: 11, camera: {pixels_per_point: 4}}}\n");
    free(plan);
}

static void mount_disk(void)
{
    guest_run("modprobe virtio_blk && modprobe ext4");
    guest_wait_for(disk, true);
    if (boot == 1) {
        guest_run("mkfs.ext4 -q %s %dM", disk, FILE_SYSTEM_MIB);
    } else {
        /* 1: the journal was replayed, or a small thing mended */
        guest_run("e2fsck -p %s >/dev/null; test $? -le 1", disk);
        guest_run("e2fsck -fn %s >/dev/null 2>&1", disk);
    }
    guest_run("mount -t ext4 %s /mnt && mkdir -p /mnt/reports", disk);
}

static bool is_whole(const char *path, int number)
{
    char content[CONTENT];
    size_t size = 0;
    char *bytes = (char *)file_read(path, &size);
    make_content(number, content);
    bool whole = bytes && size == CONTENT && memcmp(bytes, content, CONTENT) == 0;
    free(bytes);
    return whole;
}

/* All that was there or said to be there when the power failed, but for what was not synced. */
static void what_was_written_is_there(void)
{
    char path[64];
    transfer_record(false);
    TEST_ASSERT_EQUAL_INT(boot - 1, record.boot);
    TEST_ASSERT_TRUE(record.reported > 0 && record.visible < PATTERNS);
    int kept = session_files_count(session).patterns;
    printf("cut %d: %d patterns before, %d after; %d files reported as written\n", record.boot,
           record.visible, kept, record.reported);
    TEST_ASSERT_TRUE(kept >= record.visible - WRITERS);
    for (int i = 0; i < record.reported; i++) {
        report_path(record.boot, i, path, sizeof path);
        TEST_ASSERT_TRUE_MESSAGE(is_whole(path, i), path);
    }
    /* Files go on being written between the count and the cut: those that are there are whole, too. */
    report_path(record.boot, record.reported, path, sizeof path);
    for (int i = record.reported; access(path, F_OK) == 0;) {
        TEST_ASSERT_TRUE_MESSAGE(is_whole(path, i), path);
        report_path(record.boot, ++i, path, sizeof path);
    }
    TEST_ASSERT_FALSE_MESSAGE(is_whole("/mnt/unsynced", record.boot),
                              "the power was not really cut: what nobody synced is there");
}

/* Fills in what the next boot is to know, and does not come back. */
static void cut_the_power(const volatile int *reported)
{
    char content[CONTENT];
    make_content(boot, content);
    (void)fflush(stdout);
    file_write("/mnt/unsynced", content, CONTENT);
    record = (struct record){boot, session_files_count(session).patterns, *reported};
    transfer_record(true);
    guest_write("/proc/sysrq-trigger", "b");
    (void)sleep(60);
    TEST_FAIL_MESSAGE("the machine goes on");
}

static void power_fails_in_the_middle_of_a_scan(void)
{
    volatile int *reported =
        mmap(NULL, sizeof *reported, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    TEST_ASSERT_TRUE(reported != MAP_FAILED);
    int before = session_files_count(session).patterns;
    (void)unlink("/mnt/unsynced");
    (void)start_reporting(reported);
    pid_t scan = start_scan(session, boot > 1);
    while (session_files_count(session).patterns < before + 8 || *reported == 0) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(0, waitpid(scan, NULL, WNOHANG), "the scan ended early");
        (void)usleep(200);
    }
    (void)usleep(3000 * (unsigned)boot);
    cut_the_power(reported);
}

static void scan_is_resumed_to_what_an_undisturbed_one_gives(void)
{
    int status = -1;
    int before = session_files_count(session).patterns;
    TEST_ASSERT_EQUAL_INT(CUTS + 1, boot);
    pid_t resumed = start_scan(session, true);
    TEST_ASSERT_EQUAL_INT(resumed, waitpid(resumed, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
    pid_t whole = start_scan("/run/power/whole", false);
    TEST_ASSERT_EQUAL_INT(whole, waitpid(whole, &status, 0));
    TEST_ASSERT_EQUAL_INT(0, status);
    frames_expect_same("/run/power/whole", session);
    TEST_ASSERT_TRUE(before > 0 && before < PATTERNS);
    printf("%d power cuts, %d patterns kept, %d measured after them\n", CUTS, before,
           session_files_count(session).patterns - before);
    guest_run("umount /mnt && e2fsck -fn %s >/dev/null 2>&1", disk);
}

int main(int argc, char **argv)
{
    guest_require();
    boot = argc == 2 ? (int)strtol(argv[1], NULL, 10) : 0;
    if (boot < 1 || boot > CUTS + 1) {
        (void)fprintf(stderr, "usage: %s BOOT\n", argv[0]);
        return 2;
    }
    UNITY_BEGIN();
    write_settings();
    mount_disk();
    if (boot > 1) {
        RUN_TEST(what_was_written_is_there);
    }
    if (boot <= CUTS) {
        RUN_TEST(power_fails_in_the_middle_of_a_scan);
    } else {
        RUN_TEST(scan_is_resumed_to_what_an_undisturbed_one_gives);
    }
    return UNITY_END();
}
