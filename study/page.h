/* Writing an HTML page that needs nothing beside itself. */
#ifndef STUDY_PAGE_H
#define STUDY_PAGE_H

#include "base/picture.h"
#include "nacre/error.h"

#include <stdio.h>

/* Write text with the characters that mean something in HTML escaped. */
void page_text(FILE *page, const char *text);

/* A command, in which lines are not broken within the names of options. */
void page_command(FILE *page, const char *command);

/* Begin and end the page. Styles are those of study/page.c; `title` is plain text. */
void page_begin(FILE *page, const char *title);
void page_end(FILE *page);

/* Write the picture as the value of a src or href attribute: a PNG as "data:image/png;base64,...". */
int page_picture(FILE *page, const struct picture *picture, struct nacre_error *error);

#endif
