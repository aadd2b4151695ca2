/* What test programs in the lab's guest do as root: load modules, write to the kernel's files, wait. */
#ifndef TESTS_LAB_GUEST_H
#define TESTS_LAB_GUEST_H

#include <stdbool.h>

/* End the program if it does not run in the lab's guest, where it may do as it likes. */
void guest_require(void);

/* Run a line of shell; it must succeed. */
void guest_run(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* Write text to a file; it must succeed. */
void guest_write(const char *path, const char *text);

/* The first line of a file, which must be there, without its end; static memory, for eight calls. */
const char *guest_read(const char *path);

/* Wait until the path is there (or is gone); it must be so within five seconds. */
void guest_wait_for(const char *path, bool there);

#endif
