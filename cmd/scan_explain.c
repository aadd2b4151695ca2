/* nacre scan --explain: the effects of a virtual station. */
#include "cmd/scan_explain.h"

#include "cmd/effects_print.h"
#include "rig/virtual/effects_list.h"

#include <stdlib.h>

int scan_explain(const struct session *session, const char *path, bool json,
                 struct nacre_error *error)
{
    const char *sample_path = session->station.simulated.sample;
    struct effects_subject subject = {
        path, sample_path, "ms", 1e3,
        "Milliseconds are estimates for a frame on one core, of a pattern's share in it for what "
        "is "
        "done once a pattern; effects without any cost nothing beyond the others'."};
    struct sample sample = {0};
    struct effect *effects = NULL;
    size_t count = 0;
    int status = NACRE_OK;
    if (!station_is_virtual(&session->station)) {
        return nacre_fail(
            error, "%s: --explain lists what is simulated, and these devices are real", path);
    }
    if (sample_path) {
        status = sample_read(sample_path, &sample, error);
    }
    if (status == NACRE_OK) {
        status = effects_list(&session->station, sample_path ? &sample : NULL, &session->plan,
                              &effects, &count, error);
    }
    if (status == NACRE_OK) {
        status = effects_print(&subject, effects, count, json, error);
    }
    free(effects);
    sample_finish(&sample);
    return status;
}
