/* Plots, colours and text of the report's page. */
#include "study/page.h"
#include "study/palette.h"
#include "study/plot.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

void setUp(void)
{
}

void tearDown(void)
{
}

/* The text that a plot comes to; free it. */
static char *draw(const struct plot *plot)
{
    char *text = NULL;
    size_t size = 0;
    FILE *page = open_memstream(&text, &size);
    TEST_ASSERT_NOT_NULL(page);
    plot_write(page, plot);
    TEST_ASSERT_EQUAL_INT(0, fclose(page));
    return text;
}

static struct plot plain(const struct plot_series *series)
{
    return (struct plot){.title = "t",
                         .x_label = "x",
                         .y_label = "y",
                         .width = 300,
                         .height = 200,
                         .series = series,
                         .series_count = 1};
}

/* The numbers behind `mark`, the first of which is wanted. */
static double number_behind(const char *text, const char *mark)
{
    const char *found = strstr(text, mark);
    TEST_ASSERT_NOT_NULL_MESSAGE(found, mark);
    return strtod(found + strlen(mark), NULL);
}

static void points_stand_where_the_axes_say(void)
{
    static const double x[] = {0, 10};
    static const double y[] = {1, 100};
    struct plot_series series = {.x = x, .y = y, .count = 2, .colour = "#123456"};
    struct plot plot = plain(&series);
    /* the frame: 60 from the left, 12 from the right, 26 from the top, 40 from the bottom */
    char *text = draw(&plot);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, "d=\"M60.0 160.0L288.0 26.0\""), text);
    free(text);
    plot.y_log = true;
    static const double decades_x[] = {0, 5, 10};
    static const double decades_y[] = {1, 10, 100};
    series = (struct plot_series){
        .x = decades_x, .y = decades_y, .count = 3, .colour = "#123456", .dots = true};
    text = draw(&plot);
    /* 10 is the middle of the logarithmic axis */
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, "cx=\"174.0\" cy=\"93.0\""), text);
    free(text);
}

static void dots_have_sizes_and_labels(void)
{
    static const double x[] = {0, 5, 10};
    static const double y[] = {1, 2, 3};
    static const char *const labels[] = {"a<b", "2", "3"};
    struct plot_series series = {.x = x,
                                 .y = y,
                                 .count = 3,
                                 .colour = "#123456",
                                 .dots = true,
                                 .radius = 4,
                                 .labels = labels};
    struct plot plot = plain(&series);
    char *text = draw(&plot);
    /* above the dot and to its right, which is at the frame's lower left */
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, "y=\"155.5\">a&lt;b</text>"), text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, "cx=\"60.0\" cy=\"160.0\" r=\"4\""), text);
    free(text);
    series.labels = NULL;
    series.radius = 0;
    text = draw(&plot);
    TEST_ASSERT_NULL(strstr(text, "a&lt;b"));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, "cx=\"60.0\" cy=\"160.0\" r=\"2\""), text);
    free(text);
}

/* The next label's corner and width behind `text`; false behind the last. */
static bool next_label(const char **text, double *left, double *bottom, double *width)
{
    static const char mark[] = "<text class=\"label\" x=\"";
    const char *found = strstr(*text, mark);
    if (!found) {
        return false;
    }
    *left = strtod(found + strlen(mark), NULL);
    *bottom = number_behind(found, "y=\"");
    const char *begin = strchr(found, '>') + 1, *end = strchr(begin, '<');
    *width = 6 * (double)(end - begin); /* narrower than any font's digits at 11 pixels would be */
    *text = end;
    return true;
}

/* Dots in clumps of four and alone: labels cover neither each other nor dots, and stay in the drawing. */
static void labels_do_not_cover_each_other(void)
{
    enum { DOTS = 40 };
    double x[DOTS], y[DOTS], left[DOTS], bottom[DOTS], width[DOTS];
    char texts[DOTS][8];
    const char *labels[DOTS];
    size_t count = 0;
    for (int i = 0; i < DOTS; i++) {
        x[i] = i + 6 * floor(i / 4.0);
        y[i] = 100.0 / (1 + x[i]);
        (void)snprintf(texts[i], sizeof texts[i], "%d", i);
        labels[i] = texts[i];
    }
    struct plot_series series = {.x = x,
                                 .y = y,
                                 .count = DOTS,
                                 .colour = "#123456",
                                 .dots = true,
                                 .radius = 4,
                                 .labels = labels};
    struct plot plot = plain(&series);
    plot.width = 420;
    plot.height = 360;
    plot.y_log = true;
    plot.margin = 0.03;
    char *text = draw(&plot);
    for (const char *rest = text;
         count < DOTS && next_label(&rest, &left[count], &bottom[count], &width[count]);) {
        count++;
    }
    TEST_ASSERT_TRUE_MESSAGE(count >= DOTS * 3 / 4, "there is room for most");
    for (size_t i = 0; i < count; i++) {
        TEST_ASSERT_TRUE(left[i] >= 0 && left[i] + width[i] <= plot.width);
        TEST_ASSERT_TRUE(bottom[i] >= 8 && bottom[i] <= plot.height);
        for (size_t j = 0; j < i; j++) {
            TEST_ASSERT_FALSE_MESSAGE(left[i] < left[j] + width[j] &&
                                          left[j] < left[i] + width[i] &&
                                          fabs(bottom[i] - bottom[j]) < 8,
                                      "labels cover each other");
        }
    }
    for (const char *dot = text; (dot = strstr(dot, "<circle cx=\"")); dot++) {
        double across = number_behind(dot, "cx=\""), down = number_behind(dot, "cy=\"");
        for (size_t i = 0; i < count; i++) {
            TEST_ASSERT_FALSE_MESSAGE(across > left[i] && across < left[i] + width[i] &&
                                          down < bottom[i] && down > bottom[i] - 8,
                                      "a label covers a dot");
        }
    }
    free(text);
}

static void a_margin_keeps_dots_off_the_axes(void)
{
    static const double x[] = {1, 100};
    static const double y[] = {2, 4};
    struct plot_series series = {
        .x = x, .y = y, .count = 2, .colour = "#123456", .dots = true, .radius = 4};
    struct plot plot = plain(&series);
    plot.x_log = true;
    plot.margin = 0.1;
    char *text = draw(&plot);
    /* a twelfth of the frame's 228 by 134 units at each end */
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, "cx=\"79.0\" cy=\"148.8\""), text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, "cx=\"269.0\" cy=\"37.2\""), text);
    free(text);
}

/* Between 0.015 and 0.03 as between 0.55 and 8 more than powers of ten are needed. */
static void a_narrow_logarithmic_axis_has_enough_ticks(void)
{
    static const double x[] = {0, 1};
    static const double narrow[] = {0.0151, 0.031}, wide[] = {0.55, 8}, small[] = {0.0011, 0.0026};
    struct plot_series series = {.x = x, .y = narrow, .count = 2, .colour = "#123456"};
    struct plot plot = plain(&series);
    plot.y_log = true;
    char *text = draw(&plot);
    TEST_ASSERT_TRUE_MESSAGE(strstr(text, ">0.02</text>") && strstr(text, ">0.025</text>") &&
                                 strstr(text, ">0.03</text>"),
                             text);
    free(text);
    series.y = wide;
    text = draw(&plot);
    TEST_ASSERT_TRUE_MESSAGE(strstr(text, ">0.7</text>") && strstr(text, ">1</text>") &&
                                 strstr(text, ">7</text>"),
                             text);
    free(text);
    series.y = small;
    text = draw(&plot);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, ">1.5·10<tspan"), text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(text, ">2·10<tspan"), text);
    free(text);
}

static void ticks_are_round_numbers(void)
{
    static const double x[] = {0.13, 6.9};
    static const double y[] = {3e-6, 0.4};
    struct plot_series series = {.x = x, .y = y, .count = 2, .colour = "#123456"};
    struct plot plot = plain(&series);
    plot.y_log = true;
    char *text = draw(&plot);
    TEST_ASSERT_NOT_NULL(strstr(text, ">1</text>"));
    TEST_ASSERT_NOT_NULL(strstr(text, ">6</text>"));
    TEST_ASSERT_NULL(strstr(text, ">7</text>"));
    TEST_ASSERT_NOT_NULL(strstr(text, ">0.1</text>"));
    TEST_ASSERT_NOT_NULL(strstr(text, "10<tspan dy=\"-4\" font-size=\"8\">−5</tspan>"));
    TEST_ASSERT_NULL(strstr(text, "−6</tspan>"));
    free(text);
}

static void expect_finite(const char *text)
{
    TEST_ASSERT_NULL_MESSAGE(strstr(text, "nan"), text);
    TEST_ASSERT_NULL_MESSAGE(strstr(text, "inf"), text);
    TEST_ASSERT_NOT_NULL(strstr(text, "</svg>"));
}

static void awkward_data_leave_no_number_that_is_none(void)
{
    static const double rows[][4] = {
        {0, 0, 0, 0},         {5, 5, 5, 5},        {-1, -2, -3, -4},         {NAN, 1, NAN, 2},
        {NAN, NAN, NAN, NAN}, {INFINITY, 1, 2, 3}, {1e-300, 1e300, 1, 1e10}, {1e-40, 1e-41, 0, -1},
    };
    enum { ROWS = sizeof rows / sizeof rows[0] };
    for (int i = 0; i < ROWS * ROWS * 4; i++) {
        int variant = i / (ROWS * ROWS);
        struct plot_series series = {.x = rows[i % ROWS],
                                     .y = rows[i / ROWS % ROWS],
                                     .count = variant == 3 ? 0 : 4,
                                     .colour = "#123456"};
        struct plot plot = plain(&series);
        plot.y_log = variant == 1;
        plot.x_log = variant == 2;
        plot.y_floor = variant == 1 ? 1e-3 : 0;
        plot.margin = i % 2 ? 0.1 : 0;
        char *text = draw(&plot);
        expect_finite(text);
        free(text);
    }
}

static void gaps_are_not_bridged(void)
{
    static const double x[] = {0, 1, 2, 3};
    static const double y[] = {1, 2, NAN, 4};
    struct plot_series series = {.x = x, .y = y, .count = 4, .colour = "#123456"};
    struct plot plot = plain(&series);
    char *text = draw(&plot);
    const char *path = strstr(text, "stroke-linejoin");
    TEST_ASSERT_NOT_NULL(path);
    const char *second = strchr(strchr(path, 'M') + 1, 'M');
    TEST_ASSERT_TRUE(second && second < strchr(path, '>')); /* a new line begins behind the gap */
    free(text);
}

static void histogram_bars_reach_their_counts(void)
{
    static const double counts[] = {0, 4, 2};
    struct plot plot = plain(NULL);
    char *text = NULL;
    size_t size = 0;
    FILE *page = open_memstream(&text, &size);
    plot_histogram(page, &plot, counts, 3, 30, "#123456");
    TEST_ASSERT_EQUAL_INT(0, fclose(page));
    /* the greatest count fills the frame's 134 units, half of it 67 */
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 134,
                              number_behind(text, "y=\"26.0\" width=\"75.0\" height=\""));
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 67, number_behind(text, "y=\"93.0\" width=\"75.0\" height=\""));
    TEST_ASSERT_NULL(strstr(text, "height=\"0.0\""));
    free(text);
}

static void text_is_escaped(void)
{
    char *text = NULL;
    size_t size = 0;
    FILE *page = open_memstream(&text, &size);
    page_text(page, "<a href=\"x\">&'\xc3\xa9</a>");
    TEST_ASSERT_EQUAL_INT(0, fclose(page));
    TEST_ASSERT_EQUAL_STRING("&lt;a href=&quot;x&quot;&gt;&amp;&#39;\xc3\xa9&lt;/a&gt;", text);
    free(text);
}

/* Rec. 709 luminance of linear values: what the scale looks like in grey. */
static double luminance(struct colour colour)
{
    float rgb[3];
    palette_linear(colour, rgb);
    return 0.2126 * (double)rgb[0] + 0.7152 * (double)rgb[1] + 0.0722 * (double)rgb[2];
}

static void heat_rises_in_lightness_and_is_clipped(void)
{
    for (int i = 0; i < 100; i++) {
        TEST_ASSERT_TRUE(luminance(palette_heat(i / 100.0)) <
                         luminance(palette_heat((i + 1) / 100.0)));
    }
    TEST_ASSERT_TRUE(luminance(palette_heat(-3)) == luminance(palette_heat(0)));
    TEST_ASSERT_TRUE(luminance(palette_heat(7)) == luminance(palette_heat(1)));
    struct colour missing = palette_heat(NAN);
    TEST_ASSERT_TRUE(missing.r == missing.g && missing.g == missing.b);
}

static void groups_have_different_colours(void)
{
    for (size_t count = 2; count <= 100; count += 7) {
        for (size_t i = 1; i < count; i++) {
            char a[8];
            char b[8];
            palette_format(palette_group(i - 1, count), a);
            palette_format(palette_group(i, count), b);
            TEST_ASSERT_TRUE(strcmp(a, b) != 0);
            TEST_ASSERT_EQUAL_UINT64(7, strlen(a));
            TEST_ASSERT_EQUAL_UINT64(7, strspn(a, "#0123456789abcdef"));
        }
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(points_stand_where_the_axes_say);
    RUN_TEST(dots_have_sizes_and_labels);
    RUN_TEST(labels_do_not_cover_each_other);
    RUN_TEST(a_margin_keeps_dots_off_the_axes);
    RUN_TEST(a_narrow_logarithmic_axis_has_enough_ticks);
    RUN_TEST(ticks_are_round_numbers);
    RUN_TEST(awkward_data_leave_no_number_that_is_none);
    RUN_TEST(gaps_are_not_bridged);
    RUN_TEST(histogram_bars_reach_their_counts);
    RUN_TEST(text_is_escaped);
    RUN_TEST(heat_rises_in_lightness_and_is_clipped);
    RUN_TEST(groups_have_different_colours);
    return UNITY_END();
}
