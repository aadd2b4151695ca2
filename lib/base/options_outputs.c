/* Refusing to write a file over one that is to be read: a scan takes hours. */
#include "base/options_table.h"

#include <string.h>
#include <sys/stat.h>

static bool is_same_file(const struct stat *output, const char *path)
{
    struct stat input;
    return path && stat(path, &input) == 0 && input.st_dev == output->st_dev &&
           input.st_ino == output->st_ino;
}

static const char *string_of(const struct option_spec *spec, const void *settings)
{
    const char *text = NULL;
    memcpy(&text, (const char *)settings + spec->offset, sizeof text);
    return text;
}

/* Whether it is one of the arguments, or of what other options name. */
static int check_output(const struct verb *verb, const char *path, const void *settings,
                        const struct invocation *invocation, struct nacre_error *error)
{
    struct stat output;
    if (!path || stat(path, &output) != 0 || !S_ISREG(output.st_mode)) {
        return NACRE_OK;
    }
    bool same = false;
    for (int i = 0; i < invocation->operand_count && !same; i++) {
        same = is_same_file(&output, invocation->operands[i]);
    }
    for (const struct option_spec *spec = verb->options; spec && spec->name && !same; spec++) {
        same = spec->kind == OPTION_STRING && !spec->writes &&
               is_same_file(&output, string_of(spec, settings));
    }
    return same ? nacre_fail(error,
                             "%s is to be read and would be overwritten; give the output "
                             "another name",
                             path)
                : NACRE_OK;
}

int options_check_outputs(const struct verb *verb, const void *settings,
                          const struct invocation *invocation, struct nacre_error *error)
{
    int status = NACRE_OK;
    for (const struct option_spec *spec = verb->options; spec && spec->name && status == NACRE_OK;
         spec++) {
        if (spec->writes) {
            status = check_output(verb, string_of(spec, settings), settings, invocation, error);
        }
    }
    return status;
}
