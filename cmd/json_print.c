/* Printing a verb's result as JSON. */
#include "cmd/json_print.h"

#include <stdio.h>

int json_print(json_t *object, struct nacre_error *error)
{
    if (!object) {
        return nacre_fail_memory(error, "the result");
    }
    int status = json_dumpf(object, stdout, JSON_INDENT(2)) == 0 && puts("") >= 0
                     ? NACRE_OK
                     : nacre_fail(error, "standard output: cannot write the result");
    json_decref(object);
    return status;
}
