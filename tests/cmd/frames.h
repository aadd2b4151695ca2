/* Comparing what two scans of one plan left behind. */
#ifndef TESTS_CMD_FRAMES_H
#define TESTS_CMD_FRAMES_H

/* How many pattern files a session holds, and how many temporary ones that nobody finished; 0 where there is no session. */
struct session_files {
    int patterns, unfinished;
};

struct session_files session_files_count(const char *session);

/* Every file of `expected` must be in `session`, and no other, the same byte for byte. */
void frames_expect_same(const char *expected, const char *session);

/* The same of the files of frames alone, but for when they were taken, as for scans of one plan on different stations. */
void frames_expect_same_patterns(const char *expected, const char *session);

#endif
