/* The report's view of a model with a kernel per term: its planes and kernels as pictures. */
#include "study/palette.h"
#include "study/report_parts.h"

#include <math.h>

/* Terms that are shown, and decades of the kernels' logarithmic scale. */
enum { LIMIT = 24, DECADES = 5 };

/* What is shown of a plane or kernel: values[channels][size], channels `stride` numbers apart. */
struct shown {
    const float *values;
    int width, height, channels;
    size_t stride;
    bool logarithmic;
    const char *alternative;
};

static double greatest_of(const struct shown *shown)
{
    size_t size = (size_t)shown->width * (size_t)shown->height;
    double greatest = 0;
    for (int c = 0; c < shown->channels; c++) {
        for (size_t i = 0; i < size; i++) {
            greatest = fmax(greatest, (double)shown->values[(size_t)c * shown->stride + i]);
        }
    }
    return greatest;
}

/* A picture whose greatest value is the scale's end: in colour as light, of one channel or logarithmic as heat. */
static int write_picture(FILE *page, const struct shown *shown, struct nacre_error *error)
{
    size_t size = (size_t)shown->width * (size_t)shown->height;
    double greatest = greatest_of(shown);
    struct picture picture = {0};
    int status = picture_allocate(&picture, shown->width, shown->height, error);
    for (size_t i = 0; status == NACRE_OK && i < size && greatest > 0; i++) {
        double mean = 0;
        for (int c = 0; c < shown->channels; c++) {
            double value = (double)shown->values[(size_t)c * shown->stride + i] / greatest;
            mean += value / shown->channels;
            picture.rgb[3 * i + (size_t)c] = (float)value;
        }
        if (shown->channels == 1 || shown->logarithmic) {
            double place = !shown->logarithmic ? mean : mean > 0 ? 1 + log10(mean) / DECADES : 0;
            palette_linear(palette_heat(place), picture.rgb + 3 * i);
        }
    }
    (void)fprintf(page, "<img class=\"pixels\" alt=\"%s\" src=\"", shown->alternative);
    if (status == NACRE_OK) {
        status = page_picture(page, &picture, error);
    }
    (void)fputs("\">", page);
    picture_finish(&picture);
    return status;
}

static struct shown plane_shown(const struct nacre_material *m, const float *factor, int term)
{
    size_t size = (size_t)m->width * (size_t)m->height;
    return (struct shown){.values = factor + (size_t)term * (size_t)m->factor_channels * size,
                          .width = m->width,
                          .height = m->height,
                          .channels = m->factor_channels,
                          .stride = size,
                          .alternative = "plane of a term"};
}

/* The share of all light off the centre that a term carries where it meets itself: F and H at their means. */
static double weight_of(const struct nacre_material *m, int term)
{
    size_t size = (size_t)m->width * (size_t)m->height,
           area = (size_t)m->window * (size_t)m->window;
    const float *h = m->h ? m->h : m->f;
    double weight = 0;
    for (int c = 0; c < m->channels; c++) {
        size_t plane =
            (size_t)term * (size_t)m->factor_channels + (m->factor_channels == 1 ? 0 : (size_t)c);
        double f_sum = 0, h_sum = 0, kernel = 0;
        for (size_t i = 0; i < size; i++) {
            f_sum += (double)m->f[plane * size + i];
            h_sum += (double)h[plane * size + i];
        }
        for (size_t i = 0; i < area; i++) {
            kernel +=
                (double)m->kernels[((size_t)term * (size_t)m->channels + (size_t)c) * area + i];
        }
        weight += f_sum / (double)size * (h_sum / (double)size) * kernel;
    }
    return weight;
}

static int write_term(FILE *page, const struct nacre_material *m, int term, double share,
                      struct nacre_error *error)
{
    size_t area = (size_t)m->window * (size_t)m->window;
    struct shown kernel = {.values = m->kernels + (size_t)term * (size_t)m->channels * area,
                           .width = m->window,
                           .height = m->window,
                           .channels = m->channels,
                           .stride = area,
                           .logarithmic = true,
                           .alternative = "kernel of a term on a logarithmic scale"};
    struct shown f = plane_shown(m, m->f, term);
    char colour[8];
    palette_format(palette_group((size_t)term, (size_t)m->terms), colour);
    (void)fprintf(page,
                  "<figure><div class=\"point\"><h3><b style=\"background:%s\">%d</b>%.3g %%</h3>\n"
                  "<div>",
                  colour, term, 100 * share);
    int status = write_picture(page, &f, error);
    (void)fputs("<p class=\"muted\">F</p></div>\n", page);
    if (m->h && status == NACRE_OK) {
        struct shown h = plane_shown(m, m->h, term);
        (void)fputs("<div>", page);
        status = write_picture(page, &h, error);
        (void)fputs("<p class=\"muted\">H</p></div>\n", page);
    }
    (void)fputs("<div>", page);
    if (status == NACRE_OK) {
        status = write_picture(page, &kernel, error);
    }
    (void)fputs("<p class=\"muted\">g</p></div>\n</div></figure>\n", page);
    return status;
}

static int write_centre(FILE *page, const struct nacre_material *m, struct nacre_error *error)
{
    struct shown centre = {.values = m->centre,
                           .width = m->width,
                           .height = m->height,
                           .channels = m->channels,
                           .stride = (size_t)m->width * (size_t)m->height,
                           .alternative = "plane of the centre"};
    (void)fputs("<figure>\n", page);
    int status = write_picture(page, &centre, error);
    (void)fputs("\n<figcaption>The centre c, of which light leaves where it enters."
                "</figcaption>\n</figure>\n",
                page);
    return status;
}

int report_write_terms(struct report *report, struct nacre_error *error)
{
    const struct nacre_material *m = &report->material;
    FILE *page = report->page;
    double total = 0;
    int status = NACRE_OK;
    if (m->layout != NACRE_KERNEL_PER_TERM) {
        return NACRE_OK;
    }
    for (int t = 0; t < m->terms; t++) {
        total += weight_of(m, t);
    }
    (void)fprintf(
        page,
        "<h2>Terms</h2>\n<p>Where each term acts and how far: its plane%s, dark for 0 and "
        "light for its greatest value, and its kernel over %d decades of its own. The "
        "percentage is its share of the light that leaves elsewhere than it enters, "
        "planes taken at their means.</p>\n<div class=\"two\">\n",
        m->h ? "s at both ends" : ", the same at both ends", DECADES);
    for (int t = 0; t < m->terms && t < LIMIT && status == NACRE_OK; t++) {
        status = write_term(page, m, t, total > 0 ? weight_of(m, t) / total : 0, error);
    }
    if (m->centre && status == NACRE_OK) {
        status = write_centre(page, m, error);
    }
    (void)fputs("</div>\n", page);
    if (m->terms > LIMIT) {
        (void)fprintf(page, "<p>And %d more.</p>\n", m->terms - LIMIT);
    }
    return status;
}
