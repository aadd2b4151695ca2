/* The report's photograph: one that was handed over, or what the responses say a camera sees under a white pattern. */
#include "study/report_parts.h"

#include <math.h>
#include <stdlib.h>

/* Add what light that enters at (x, y) sends out to every point around it. */
static void add_response(const struct nacre_scan_info *info, int x, int y, const float *response,
                         struct picture *picture)
{
    int half = info->window / 2, area = info->window * info->window;
    for (int i = 0; i < area; i++) {
        int xo = x + i % info->window - half, yo = y + i / info->window - half;
        if (xo < 0 || yo < 0 || xo >= info->width || yo >= info->height) {
            continue;
        }
        float *rgb = picture->rgb + 3 * ((size_t)yo * (size_t)info->width + (size_t)xo);
        for (int c = 0; c < 3; c++) {
            float value = response[(info->channels == 1 ? 0 : c) * area + i];
            rgb[c] += isnan(value) ? 0 : value;
        }
    }
}

/* The sum over all points that light enters at. */
static int sum_responses(const struct report *report, struct picture *picture,
                         struct nacre_error *error)
{
    const struct nacre_scan_info *info = nacre_scan_info(report->scan);
    float *response = malloc(nacre_scan_response_size(info) * sizeof *response);
    int status = picture_allocate(picture, info->width, info->height, error);
    if (!response) {
        status = nacre_fail_memory(error, "a response");
        goto out;
    }
    for (int y = 0; y < info->height && status == NACRE_OK; y++) {
        for (int x = 0; x < info->width && status == NACRE_OK; x++) {
            status = nacre_scan_read(report->scan, x, y, response, error);
            if (status == NACRE_OK) {
                add_response(info, x, y, response, picture);
            }
        }
    }
out:
    free(response);
    return status;
}

int report_write_photograph(struct report *report, struct nacre_error *error)
{
    const char *given = report->request->photograph;
    FILE *page = report->page;
    struct picture picture = {0};
    int status =
        given ? picture_read(given, &picture, error) : sum_responses(report, &picture, error);
    (void)fprintf(page, "<figure>\n<img%s alt=\"photograph of the sample\" src=\"",
                  given ? "" : " class=\"pixels\"");
    if (status == NACRE_OK) {
        status = page_picture(page, &picture, error);
    }
    (void)fputs("\">\n<figcaption>", page);
    if (given) {
        (void)fputs("Photograph: ", page);
        page_text(page, report_base_name(given));
    } else {
        (void)fputs(
            "Under a white pattern: what leaves each point when all are lit, the sum of the "
            "measured responses, as sRGB. The border lacks the light that would come from "
            "beyond it.",
            page);
    }
    (void)fputs("</figcaption>\n</figure>\n", page);
    picture_finish(&picture);
    return status;
}
