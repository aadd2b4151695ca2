/* Examples in the documentation. */
#include "tests/docs.h"

#include "tests/files.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

char *docs_example(const char *document, const char *heading)
{
    static const char fence[] = "```yaml\n";
    char *path = path_join(DOCS, document), *line = NULL, *example = NULL;
    size_t size = 0;
    char *text = (char *)file_read(path, &size);
    if (asprintf(&line, "\n## %s\n", heading) < 0) {
        abort();
    }
    char *section = text ? strstr(text, line) : NULL;
    char *begin = section ? strstr(section, fence) : NULL;
    char *end = begin ? strstr(begin + strlen(fence), "\n```\n") : NULL;
    if (end) {
        end[1] = '\0';
        example = strdup(begin + strlen(fence));
    }
    if (!example) {
        (void)fprintf(stderr, "%s: no example below \"## %s\"\n", path, heading);
        abort();
    }
    free(path);
    free(line);
    free(text);
    return example;
}
