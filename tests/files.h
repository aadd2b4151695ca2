/* Files and folders that tests make and look at. What cannot be made ends the program with the reason. */
#ifndef TESTS_FILES_H
#define TESTS_FILES_H

#include <stddef.h>
#include <stdint.h>

/* A new empty folder below $TMPDIR or /tmp; heap. folder_remove removes it with all it holds and frees the name; NULL is left
 * alone. */
char *folder_make(void);
void folder_remove(char *folder);

/* FOLDER/NAME; heap. */
char *path_join(const char *folder, const char *name);

/* The names of everything below `folder`, sorted, with sizes and hashes of files, one a line; heap. Two equal texts
 * mean that nothing was added, removed or altered. */
char *folder_describe(const char *folder);

/* The bytes of a file, with a 0 behind them; heap, NULL when it cannot be read. */
uint8_t *file_read(const char *path, size_t *size);
void file_write(const char *path, const void *bytes, size_t size);
void text_write(const char *path, const char *text);

#endif
