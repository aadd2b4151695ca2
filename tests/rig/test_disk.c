/* Tests of a disk that fills up while a scan runs: a real one, in memory, which others fill. */
#include "rig/sequence.h"

#include "../cmd/mounts.h"
#include "stage.h"
#include "unity.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

/* 16 patterns of two exposures of 24 x 20 pixels take at most 16 * 2 * (1920 + 4096) bytes, 188 KiB. When the ninth begins
 * the writer, who holds six at most, has written two. */
enum { DISK_BYTES = 1 << 20, FILLS_AT = 9 };

static struct stage stage;
static struct session session;
static struct sequence_result result;
static struct operator_log log_;
static struct nacre_error error;
static char disk[128], filler[160], path[160];

void setUp(void)
{
    log_ = (struct operator_log){0};
    stage_make(&stage, NULL, NULL);
    (void)snprintf(disk, sizeof disk, "%s/disk", stage.folder);
    (void)snprintf(filler, sizeof filler, "%s/filler", disk);
    (void)snprintf(path, sizeof path, "%s/session", disk);
    TEST_ASSERT_EQUAL_INT(0, mkdir(disk, 0777));
}

void tearDown(void)
{
    session_finish(&session);
    mounts_remove(disk);
    stage_remove(&stage);
}

/* Leave `left` bytes free. */
static void fill(size_t left)
{
    static char zeros[4096];
    struct statvfs now;
    int file = open(filler, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    TEST_ASSERT_TRUE(file >= 0);
    TEST_ASSERT_EQUAL_INT(0, statvfs(disk, &now));
    while ((size_t)now.f_bavail * now.f_frsize > left &&
           write(file, zeros, sizeof zeros) > 0) { /* the scan may have taken the last page */
        TEST_ASSERT_EQUAL_INT(0, statvfs(disk, &now));
    }
    TEST_ASSERT_EQUAL_INT(0, close(file));
}

static void fill_to_the_brim(void)
{
    fill(0);
}

/* Less than one pattern may need, which is 2 * (1920 + 4096) bytes. */
static void fill_nearly(void)
{
    fill(8192);
}

static void full_disk_stops_the_scan_before_a_write_fails(void (*filling)(void))
{
    if (!mounts_disk(disk, DISK_BYTES)) {
        TEST_IGNORE_MESSAGE("nothing can be mounted here");
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, session_create(path, stage.station, NULL, false, &session, &error), error.text);
    log_.call_at = FILLS_AT;
    log_.call = filling;
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          stage_scan(&session, FAULT_LOST, -1, 0, &log_, &result, &error));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "MiB free, too little to go on"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "--resume"), error.text);
}

/* Those that were handed to the writer when the disk was full may fail or not: the check is made before the next. */
static void scan_goes_on_when_there_is_room_again(void (*filling)(void))
{
    full_disk_stops_the_scan_before_a_write_fails(filling);
    TEST_ASSERT_TRUE(result.patterns <= FILLS_AT - 1);
    TEST_ASSERT_EQUAL_INT(0, unlink(filler));
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, stage_scan(&session, FAULT_LOST, -1, 0, &log_, &result, &error), error.text);
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, result.patterns + result.skipped);
    TEST_ASSERT_TRUE(result.skipped > 0);
}

static void disk_filled_to_the_brim_stops_the_scan_which_goes_on_later(void)
{
    scan_goes_on_when_there_is_room_again(fill_to_the_brim);
}

static void disk_with_too_little_room_stops_the_scan_which_goes_on_later(void)
{
    scan_goes_on_when_there_is_room_again(fill_nearly);
}

static void fill_half(void)
{
    fill(DISK_BYTES / 2);
}

static void disk_with_room_enough_stops_nothing(void)
{
    if (!mounts_disk(disk, DISK_BYTES)) {
        TEST_IGNORE_MESSAGE("nothing can be mounted here");
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, session_create(path, stage.station, NULL, false, &session, &error), error.text);
    log_.call_at = FILLS_AT;
    log_.call = fill_half;
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, stage_scan(&session, FAULT_LOST, -1, 0, &log_, &result, &error), error.text);
}

int main(void)
{
    (void)mounts_enter(); /* where that fails, mounting does */
    UNITY_BEGIN();
    RUN_TEST(disk_filled_to_the_brim_stops_the_scan_which_goes_on_later);
    RUN_TEST(disk_with_too_little_room_stops_the_scan_which_goes_on_later);
    RUN_TEST(disk_with_room_enough_stops_nothing);
    return UNITY_END();
}
