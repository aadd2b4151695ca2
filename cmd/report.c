/* nacre report: one page on how well a material stands for its scan. */
#include "study/report.h"
#include "cmd/verbs.h"

#include <limits.h>

struct report_settings {
    const char *output, *photograph;
};

static const struct option_spec report_options[] = {
    {.name = "output",
     .letter = 'o',
     .kind = OPTION_STRING,
     .argument = "FILE",
     .required = true,
     .offset = offsetof(struct report_settings, output),
     .writes = true,
     .sentence = "the HTML page to write"},
    {.name = "photograph",
     .kind = OPTION_STRING,
     .argument = "FILE",
     .offset = offsetof(struct report_settings, photograph),
     .sentence =
         "a picture of the sample (EXR or PNG), in place of what the responses say it looks "
         "like under a white pattern"},
    {0}};

static int report_run(const void *settings, const struct invocation *invocation,
                      struct nacre_error *error)
{
    const struct report_settings *s = settings;
    struct report_request request = {.scan = invocation->operands[0],
                                     .material = invocation->operands[1],
                                     .photograph = s->photograph,
                                     .pictures = invocation->operands + 2,
                                     .picture_count = (size_t)invocation->operand_count - 2};
    struct progress progress = progress_begin("comparing", invocation->quiet);
    int status = report_write(s->output, &request, &progress, error);
    progress_end(&progress);
    return status;
}

const struct verb verb_report = {
    .name = "report",
    .operands = "SCAN MATERIAL [PICTURE...] -o FILE",
    .summary = "write a page on how well a material stands for its scan",
    .text =
        "The page is one HTML file without scripts that needs nothing beside itself, to be read "
        "on any screen and printed. It shows the sample under a white pattern, its albedo, a map "
        "of the relative error, "
        "measured responses beside their factored counterparts on a logarithmic scale, how the "
        "factorization converged, the kernels' radial fall-off with a map of the clusters, and "
        "the row of Table 1 of Peers et al. 2006. Pictures (EXR or PNG), such as renders, are "
        "put in at the end.",
    .operand_minimum = 2,
    .operand_maximum = INT_MAX,
    .options = report_options,
    .settings_size = sizeof(struct report_settings),
    .run = report_run,
};
