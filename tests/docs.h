/* Examples in the documentation, which tests read from there. */
#ifndef TESTS_DOCS_H
#define TESTS_DOCS_H

/* The first ```yaml block below the heading "## HEADING" of a document in docs/, "formats.md"; heap. One that is not there ends
 * the program. */
char *docs_example(const char *document, const char *heading);

#endif
