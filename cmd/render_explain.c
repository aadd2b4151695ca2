/* nacre render --explain: the effects of a scene. */
#include "cmd/render_explain.h"

#include "cmd/effects_print.h"
#include "render/effects_list.h"

#include <stdlib.h>

int render_explain(const char *path, const struct scene *scene,
                   const struct render_settings *settings, bool json, struct nacre_error *error)
{
    const struct effects_subject subject = {
        path, NULL, "s", 1,
        "Seconds are estimates for one core, without POV-Ray's; effects without any cost nothing "
        "beyond the others'."};
    struct stage stage;
    struct render_report report = {0};
    struct effect *effects = NULL;
    size_t count = 0;
    int status = stage_prepare(&stage, scene, settings, &report, error);
    if (status == NACRE_OK) {
        status = render_effects_list(&stage, &effects, &count, error);
    }
    if (status == NACRE_FAILED) {
        (void)nacre_fail_within(error, "%s", path);
    }
    if (status == NACRE_OK) {
        status = effects_print(&subject, effects, count, json, error);
    }
    free(effects);
    render_report_finish(&report);
    stage_finish(&stage);
    return status;
}
