/* Printing effects: simulated or not, what each costs, why, and the line that says so. */
#include "cmd/effects_print.h"

#include "cmd/json_print.h"

#include <jansson.h>
#include <stdio.h>

static const char *file_of(const struct effects_subject *subject, const struct effect *effect)
{
    return effect->in_sample || !subject->station ? subject->sample : subject->station;
}

static json_t *as_json(const struct effects_subject *subject, const struct effect *effects,
                       size_t count)
{
    json_t *list = json_array();
    for (size_t i = 0; i < count && list; i++) {
        json_t *entry = json_pack(
            "{s:s, s:b, s:s?, s:i, s:f, s:s}", "effect", effects[i].name, "simulated",
            effects[i].simulated, "file", effects[i].line ? file_of(subject, &effects[i]) : NULL,
            "line", effects[i].line, "seconds", effects[i].seconds, "reason", effects[i].reason);
        if (json_array_append_new(list, entry)) {
            json_decref(list);
            list = NULL;
        }
    }
    return list;
}

int effects_print(const struct effects_subject *subject, const struct effect *effects, size_t count,
                  bool json, struct nacre_error *error)
{
    if (json) {
        return json_print(as_json(subject, effects, count), error);
    }
    for (size_t i = 0; i < count; i++) {
        const struct effect *effect = &effects[i];
        printf("%-9s %-36s", effect->simulated ? "simulated" : "left out", effect->name);
        if (effect->seconds > 0) {
            double cost = effect->seconds * subject->units_a_second;
            printf(" %6.*f %-3s", cost < 0.1 ? 3 : 1, cost, subject->unit);
        } else {
            printf(" %10s", "");
        }
        printf("%s", effect->reason);
        if (effect->line) {
            printf(" (%s:%d)", file_of(subject, effect), effect->line);
        }
        printf("\n");
    }
    printf("%s\n", subject->note);
    return NACRE_OK;
}
