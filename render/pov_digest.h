/* Files that show whether anybody has changed them since nacre wrote them: each carries a digest of itself, a text in its
 * first line, a picture in an attribute. */
#ifndef RENDER_POV_DIGEST_H
#define RENDER_POV_DIGEST_H

#include "base/picture.h"
#include "render/output_file.h"

#include <stdbool.h>

/* A text for POV-Ray, with the digest in a comment before it; else as in output_file.h. */
int pov_text_open(struct output_file *output, char *path, struct nacre_error *error);
int pov_text_close(struct output_file *output, int status, struct nacre_error *error);

/* Takes over `path`, which may be NULL where memory ran out. */
int pov_picture_write(char *path, const struct picture *picture, struct nacre_error *error);

/* Whether the file is as one of the above left it; what cannot be read is not. */
bool pov_is_as_written(const char *path);

#endif
