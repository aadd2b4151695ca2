/* The report of made materials whose error is known. */
#include "study/report.h"

#include "base/picture.h"
#include "nacre/evaluate.h"
#include "nacre/scan.h"
#include "tests/nacre/made_material.h"
#include "tests/nacre/scratch.h"

#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static const struct made_material paper = {.layout = NACRE_KERNEL_SINGLE,
                                           .pixel = NACRE_FLOAT,
                                           .channels = 3,
                                           .factor_channels = 3,
                                           .mixed = 1,
                                           .with_h = true};

void setUp(void)
{
    scratch_make();
}

void tearDown(void)
{
    scratch_remove();
}

/* A scan of the material's own responses times `factor`; of the points from `unmeasured` on none is written. */
static void write_scan(const char *name, const struct nacre_material *m, float factor,
                       int unmeasured)
{
    struct nacre_error error = {0};
    struct nacre_scan_writer *writer = NULL;
    struct nacre_scan_info info = {.width = m->width,
                                   .height = m->height,
                                   .window = m->window,
                                   .channels = m->channels,
                                   .pixel = NACRE_FLOAT,
                                   .pitch_mm = m->pitch_mm,
                                   .source = "made <for> a \"test\" & more"};
    size_t size = nacre_scan_response_size(&info);
    float *response = calloc(size, sizeof *response);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, nacre_scan_create(scratch_path(name), &info, &writer, &error), error.text);
    for (int i = 0; i < m->width * m->height && i < unmeasured; i++) {
        nacre_material_response(m, i % m->width, i / m->width, response);
        for (size_t k = 0; k < size; k++) {
            response[k] *= factor;
        }
        TEST_ASSERT_EQUAL_INT(
            NACRE_OK, nacre_scan_write(writer, i % m->width, i / m->width, response, &error));
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_scan_commit(writer, &error), error.text);
    free(response);
}

static void write_material(const char *name, const struct nacre_material *m)
{
    struct nacre_error error = {0};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, nacre_material_write(scratch_path(name), m, &error),
                                  error.text);
}

static int write_report(const char *scan, const char *material, char *const *pictures, size_t count,
                        struct nacre_error *error)
{
    struct report_request request = {.scan = scratch_path(scan),
                                     .material = scratch_path(material),
                                     .pictures = pictures,
                                     .picture_count = count};
    return report_write(scratch_path("r.html"), &request, NULL, error);
}

/* The page's text, which the caller frees. */
static char *load_report(const char *scan, const char *material)
{
    struct nacre_error error = {0};
    size_t size = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, write_report(scan, material, NULL, 0, &error),
                                  error.text);
    char *text = (char *)scratch_load("r.html", &size);
    TEST_ASSERT_EQUAL_UINT64(size, strlen(text));
    return text;
}

/* The page of a made material beside a scan that is `factor` times as bright. */
static char *make_report(struct made_material wanted, float factor)
{
    struct nacre_material m = made_material(wanted);
    write_scan("s.exr", &m, factor, m.width * m.height);
    write_material("m.exr", &m);
    nacre_material_finish(&m);
    return load_report("s.exr", "m.exr");
}

static void expect_contains(const char *page, const char *text)
{
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(page, text), text);
}

/* The length of the name that begins a tag. */
static size_t name_length(const char *name)
{
    size_t length = 0;
    while (isalnum((unsigned char)name[length])) {
        length++;
    }
    return length;
}

static bool is_named(const char *name, const char *wanted)
{
    return name_length(name) == strlen(wanted) && strncmp(name, wanted, strlen(wanted)) == 0;
}

/* Every tag is closed, in order; nothing is a script or comes from elsewhere; numbers are numbers. */
static void expect_sound(const char *page)
{
    enum { DEPTH = 32 };
    const char *open[DEPTH] = {NULL};
    size_t depth = 0;
    TEST_ASSERT_NOT_NULL(strstr(page, "<!DOCTYPE html>"));
    for (const char *at = strchr(page + 1, '<'); at; at = strchr(at + 1, '<')) {
        const char *name = at + 1 + (at[1] == '/');
        const char *end = strchr(at, '>');
        TEST_ASSERT_NOT_NULL(end);
        if (at[1] == '/') {
            const char *opened = depth > 0 ? open[--depth] : NULL;
            if (!opened || name_length(opened) != name_length(name) ||
                strncmp(opened, name, name_length(name)) != 0) {
                TEST_FAIL_MESSAGE(at);
            }
        } else if (end[-1] != '/' && !is_named(name, "meta") && !is_named(name, "img")) {
            TEST_ASSERT_TRUE(depth < DEPTH);
            open[depth++] = name;
        }
        TEST_ASSERT_FALSE(is_named(name, "script"));
        TEST_ASSERT_FALSE(is_named(name, "link"));
        /* the text behind the tag */
        for (const char *text = end; *text && *text != '<'; text++) {
            TEST_ASSERT_TRUE(strncmp(text, "nan", 3) != 0 || isalpha((unsigned char)text[-1]));
        }
    }
    TEST_ASSERT_EQUAL_UINT64(0, depth);
    TEST_ASSERT_NULL(strstr(page, "http"));
    for (const char *at = strstr(page, "src=\""); at; at = strstr(at + 1, "src=\"")) {
        TEST_ASSERT_EQUAL_INT(0, strncmp(at + 5, "data:image/png;base64,", 22));
    }
    for (const char *at = strstr(page, "href=\""); at; at = strstr(at + 1, "href=\"")) {
        TEST_ASSERT_EQUAL_INT(0, strncmp(at + 6, "data:image/png;base64,", 22));
    }
}

/* Measured is 5/4 of factored: ||m - f|| / ||m|| = 1/5 at every point, with and without the centre; its square is
 * 0.04. Sizes: 99 points x 25 x 3 x 4 bytes = 29700; the material's 8427 bytes are told in test_material.c. */
static void page_tells_the_error_and_the_row_of_table_1(void)
{
    char *page = make_report(paper, 1.25f);
    expect_sound(page);
    expect_contains(page, "<b>20.00 %</b><span>mean relative error</span>");
    expect_contains(page, "<b>1 / 4</b>");
    expect_contains(page, "<td>m.exr</td><td>0.275 × 0.225</td><td>11 × 9</td><td>5 × 5</td>"
                          "<td>3</td><td>4</td><td>29 KiB</td><td>8.23 KiB</td><td>1/3.5</td>"
                          "<td>0.200 / 0.200 / 0.200</td>");
    expect_contains(page, "min / avg / max</th><td>0.200 / 0.200 / 0.200</td>");
    expect_contains(page, "<td>0.04; without the centre 0.04</td>");
    expect_contains(page, "<td>99 of 99; 0 not measured, 0 measured as exactly 0</td>");
    expect_contains(page, "hals, 17 iterations, seed -3, ε = 0.125");
    expect_contains(page, "no history");
    for (int i = 0; i < 6; i++) {
        char mark[16];
        (void)snprintf(mark, sizeof mark, "<h3><b>%c</b>(", 'A' + i);
        expect_contains(page, mark);
    }
    free(page);
}

/* Errors are alike, so the least and the greatest are the first point and the last: two corners of 11 x 9 points. */
static void letters_stand_within_the_albedo(void)
{
    static const char mark[] = "text-anchor=\"middle\" style=\"font-size:";
    int letters = 0;
    char *page = make_report(paper, 1.25f);
    for (const char *at = strstr(page, mark); at; at = strstr(at + 1, mark)) {
        const char *element = at;
        double size = strtod(at + strlen(mark), NULL);
        while (strncmp(element, "<text ", 6) != 0) {
            element--;
        }
        double x = strtod(element + strlen("<text x=\""), NULL);
        double y = strtod(strstr(element, " y=\"") + strlen(" y=\""), NULL);
        /* y is a capital's foot, which is less than 0.8 of the font's size below its head */
        TEST_ASSERT_TRUE(x > 0.4 * size && x < 11 - 0.4 * size);
        TEST_ASSERT_TRUE(y > 0.8 * size && y < 9);
        letters++;
    }
    TEST_ASSERT_EQUAL_INT(6, letters);
    free(page);
}

/* A channel's colour is told where there are three, and nothing of channels where there is one. */
static void colours_of_the_cuts_are_told(void)
{
    struct made_material wanted = paper;
    char *page = make_report(wanted, 1);
    expect_contains(page, "></i>green</span>");
    free(page);
    wanted.channels = wanted.factor_channels = 1;
    page = make_report(wanted, 1);
    TEST_ASSERT_NULL(strstr(page, "></i>green</span>"));
    free(page);
}

static void every_layout_has_a_page(void)
{
    struct made_material wanted = paper;
    wanted.layout = NACRE_KERNEL_PAIR;
    wanted.mixed = 2;
    wanted.channels = wanted.factor_channels = 1;
    char *page = make_report(wanted, 0.8f);
    expect_sound(page);
    expect_contains(page, "0.250 / 0.250 / 0.250"); /* 1 - 1/0.8 */
    expect_contains(page, "one per pair of clusters");
    free(page);
    wanted = (struct made_material){.layout = NACRE_KERNEL_PER_TERM,
                                    .pixel = NACRE_HALF,
                                    .channels = 3,
                                    .factor_channels = 1,
                                    .with_centre = true};
    page = make_report(wanted, 1);
    expect_sound(page);
    expect_contains(page, "one per term");
    expect_contains(page, "<td>3</td><td>none</td>");
    free(page);
}

static int count_of(const char *page, const char *text)
{
    int count = 0;
    for (const char *at = strstr(page, text); at; at = strstr(at + 1, text)) {
        count++;
    }
    return count;
}

/* A term that is 1 everywhere at both ends and has a kernel of 3 at each of 25 entries carries 75; one of 0.5 at both ends
 * carries a quarter of that; one whose kernel is 0 nothing: 80, 20 and 0 %. */
static void terms_are_shown_by_planes_kernels_and_shares(void)
{
    struct made_material wanted = {.layout = NACRE_KERNEL_PER_TERM,
                                   .pixel = NACRE_FLOAT,
                                   .channels = 1,
                                   .factor_channels = 1,
                                   .with_h = true,
                                   .with_centre = true};
    struct nacre_material m = made_material(wanted);
    for (int i = 0; i < 3 * 99; i++) {
        m.f[i] = m.h[i] = i < 99 ? 1 : 0.5f;
    }
    for (int i = 0; i < 3 * 25; i++) {
        m.kernels[i] = i < 50 ? 3 : 0;
    }
    write_scan("s.exr", &m, 1, 99);
    write_material("m.exr", &m);
    nacre_material_finish(&m);
    char *page = load_report("s.exr", "m.exr");
    expect_sound(page);
    expect_contains(page, ">0</b>80 %</h3>");
    expect_contains(page, ">1</b>20 %</h3>");
    expect_contains(page, ">2</b>0 %</h3>");
    TEST_ASSERT_EQUAL_INT(6, count_of(page, "alt=\"plane of a term\""));
    TEST_ASSERT_EQUAL_INT(3, count_of(page, "alt=\"kernel of a term"));
    TEST_ASSERT_EQUAL_INT(1, count_of(page, "alt=\"plane of the centre\""));
    free(page);
    page = make_report(paper, 1.25f);
    TEST_ASSERT_NULL(strstr(page, "<h2>Terms</h2>"));
    free(page);
}

/* 10 % at the first iteration, not looked at after the second, 1 % after the third: one line from (1, 10) to (3, 1). */
static void error_is_plotted_beside_the_objective(void)
{
    struct nacre_material m = made_material(paper);
    static const float errors[] = {0.1f, NAN, 0.01f};
    m.history_count = 3;
    m.history_objective = calloc(3, sizeof(float));
    m.history_seconds = calloc(3, sizeof(float));
    m.history_error = calloc(3, sizeof(float));
    for (int i = 0; i < 3; i++) {
        m.history_objective[i] = 1 + (float)i;
        m.history_error[i] = errors[i];
    }
    write_scan("s.exr", &m, 1, 99);
    write_material("m.exr", &m);
    nacre_material_finish(&m);
    char *page = load_report("s.exr", "m.exr");
    expect_sound(page);
    const char *plot = strstr(page, "Error over iterations");
    TEST_ASSERT_NOT_NULL(plot);
    expect_contains(plot, "d=\"M60.0 26.0L408.0 220.0\"");
    free(page);
}

static void names_warnings_and_sources_are_escaped(void)
{
    struct nacre_error error = {0};
    struct nacre_material m = made_material(paper);
    strncpy(m.method, "<i>&\"m\"", sizeof m.method - 1);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, nacre_material_warn(&m, "dim </p><script>", &error));
    write_scan("<s>&'.exr", &m, 1.25f, 99);
    write_material("<m>\"&.exr", &m);
    nacre_material_finish(&m);
    char *page = load_report("<s>&'.exr", "<m>\"&.exr");
    expect_sound(page);
    expect_contains(page, "<h1>&lt;m&gt;&quot;&amp;.exr</h1>");
    expect_contains(page, "<code>&lt;s&gt;&amp;&#39;.exr</code>");
    expect_contains(page, "made &lt;for&gt; a &quot;test&quot; &amp; more");
    expect_contains(page, "<p>dim &lt;/p&gt;&lt;script&gt;</p>");
    expect_contains(page, "&lt;i&gt;&amp;&quot;m&quot;, 17 iterations");
    free(page);
}

static void convergence_is_plotted(void)
{
    struct nacre_material m = made_material(paper);
    m.history_count = 3;
    m.history_objective = calloc(3, sizeof(float));
    m.history_seconds = calloc(3, sizeof(float));
    for (int i = 0; i < 3; i++) {
        m.history_objective[i] = powf(10, (float)(2 - i));
        m.history_seconds[i] = 0.5f * (float)i;
    }
    write_scan("s.exr", &m, 1, 99);
    write_material("m.exr", &m);
    nacre_material_finish(&m);
    char *page = load_report("s.exr", "m.exr");
    expect_sound(page);
    expect_contains(page, "Objective over iterations");
    expect_contains(page, "Objective over time");
    /* 100, 10, 1 at 1, 2, 3: a straight line from corner to corner of a 420 x 260 plot */
    expect_contains(page, "d=\"M60.0 26.0L234.0 123.0L408.0 220.0\"");
    TEST_ASSERT_NULL(strstr(page, "no history"));
    free(page);
}

static void points_that_were_not_measured_are_counted_apart(void)
{
    struct nacre_material m = made_material(paper);
    write_material("m.exr", &m);
    write_scan("s.exr", &m, 1.25f, 60);
    write_scan("none.exr", &m, 1.25f, 0);
    nacre_material_finish(&m);
    char *page = load_report("s.exr", "m.exr");
    expect_sound(page);
    expect_contains(page, "Grey: 39 not measured, 0 measured as exactly 0.");
    expect_contains(page, "<td>60 of 99; 39 not measured");
    expect_contains(page, "0.200 / 0.200 / 0.200");
    free(page);
    page = load_report("none.exr", "m.exr");
    expect_sound(page);
    expect_contains(page, "<td>none</td></tr>");
    expect_contains(page, "Fewer than six surface points have been measured.");
    free(page);
}

static int digit_of(char c)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    const char *found = c ? strchr(digits, c) : NULL;
    return found ? (int)(found - digits) : -1;
}

/* Decode the base64 text at `at` into the file NAME. */
static void store_decoded(const char *at, const char *name)
{
    size_t length = strcspn(at, "\"");
    unsigned char *bytes = malloc(length + 4);
    size_t size = 0;
    unsigned word = 0;
    int bits = 0;
    for (size_t i = 0; i < length && at[i] != '='; i++) {
        TEST_ASSERT_TRUE(digit_of(at[i]) >= 0);
        word = (word << 6 | (unsigned)digit_of(at[i])) & 0xffffff;
        bits += 6;
        if (bits >= 8) {
            bits -= 8;
            bytes[size++] = (unsigned char)(word >> bits & 255);
        }
    }
    TEST_ASSERT_EQUAL_UINT64(0, length % 4);
    scratch_store(name, bytes, size);
    free(bytes);
}

/* The first picture of the page. */
static struct picture first_picture(const char *page)
{
    struct nacre_error error = {0};
    struct picture picture = {0};
    const char *mark = "data:image/png;base64,";
    const char *found = strstr(page, mark);
    TEST_ASSERT_NOT_NULL(found);
    store_decoded(found + strlen(mark), "first.png");
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, picture_read(scratch_path("first.png"), &picture, &error), error.text);
    return picture;
}

/* Each point of the picture is the sum of what every lit point sends there. */
static void the_sample_is_shown_under_a_white_pattern(void)
{
    struct nacre_material m = made_material(paper);
    write_scan("s.exr", &m, 0.01f, 99);
    write_material("m.exr", &m);
    char *page = load_report("s.exr", "m.exr");
    struct picture got = first_picture(page);
    size_t area = (size_t)m.window * (size_t)m.window;
    float *response = calloc(3 * area, sizeof *response);
    double sum = 0;
    TEST_ASSERT_EQUAL_INT(m.width, got.width);
    TEST_ASSERT_EQUAL_INT(m.height, got.height);
    int half = m.window / 2, x = m.width / 2, y = m.height / 2;
    for (int v = -half; v <= half; v++) {
        for (int u = -half; u <= half; u++) {
            if (x - u >= 0 && x - u < m.width && y - v >= 0 && y - v < m.height) {
                nacre_material_response(&m, x - u, y - v, response);
                int entry = (v + half) * m.window + u + half;
                sum += 0.01 * (double)response[area + (size_t)entry];
            }
        }
    }
    /* 8 bits of sRGB: half a step of 1/255 is at most 1/220 in linear values. */
    sum = sum > 1 ? 1 : sum;
    TEST_ASSERT_TRUE(sum > 0.02);
    TEST_ASSERT_DOUBLE_WITHIN(1.0 / 220, sum, (double)got.rgb[3 * (y * m.width + x) + 1]);
    expect_contains(page, "Under a white pattern");
    picture_finish(&got);
    nacre_material_finish(&m);
    free(response);
    free(page);
}

static void a_photograph_takes_the_place_of_the_white_pattern(void)
{
    struct nacre_error error = {0};
    struct picture given = {0};
    size_t size = 0;
    char *path = strdup(scratch_path("<photo>.png"));
    struct nacre_material m = made_material(paper);
    write_scan("s.exr", &m, 1, 99);
    write_material("m.exr", &m);
    nacre_material_finish(&m);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_allocate(&given, 4, 3, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_write(path, &given, NULL, &error));
    struct report_request request = {
        .scan = scratch_path("s.exr"), .material = scratch_path("m.exr"), .photograph = path};
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, report_write(scratch_path("r.html"), &request, NULL, &error), error.text);
    char *page = (char *)scratch_load("r.html", &size);
    expect_sound(page);
    expect_contains(page, "Photograph: &lt;photo&gt;.png");
    TEST_ASSERT_NULL(strstr(page, "Under a white pattern"));
    struct picture got = first_picture(page);
    TEST_ASSERT_EQUAL_INT(4, got.width);
    TEST_ASSERT_EQUAL_INT(3, got.height);
    request.photograph = "missing.png";
    scratch_hush();
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          report_write(scratch_path("r2.html"), &request, NULL, &error));
    scratch_hush_end();
    TEST_ASSERT_NOT_NULL(strstr(error.text, "missing.png"));
    picture_finish(&got);
    picture_finish(&given);
    free(page);
    free(path);
}

/* The first image is the sample under white, the second its albedo, point for point; the last the picture that was
 * handed over. */
static void images_are_whole_pngs(void)
{
    struct nacre_error error = {0};
    struct picture given = {0};
    struct picture got = {0};
    size_t size = 0;
    char *pictures[] = {strdup(scratch_path("a \"render\" & more.png"))};
    struct nacre_material m = made_material(paper);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_allocate(&given, 5, 2, &error));
    for (int i = 0; i < 30; i++) {
        given.rgb[i] = (float)i / 29;
    }
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_write(pictures[0], &given, NULL, &error));
    write_scan("s.exr", &m, 1.25f, 99);
    write_material("m.exr", &m);
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, write_report("s.exr", "m.exr", pictures, 1, &error),
                                  error.text);
    char *page = (char *)scratch_load("r.html", &size);
    expect_sound(page);
    expect_contains(page, "<figcaption>a &quot;render&quot; &amp; more.png</figcaption>");
    const char *mark = "data:image/png;base64,";
    const char *last = NULL;
    int count = 0;
    for (const char *at = strstr(page, mark); at; at = strstr(at + 1, mark)) {
        last = at + strlen(mark);
        store_decoded(last, "x.png");
        TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, picture_read(scratch_path("x.png"), &got, &error),
                                      error.text);
        if (count == 1) {
            TEST_ASSERT_EQUAL_INT(11, got.width);
            TEST_ASSERT_EQUAL_INT(9, got.height);
            /* 8 bits of sRGB: half a step of 1/255 is at most 1/220 in linear values */
            TEST_ASSERT_FLOAT_WITHIN(1.0f / 220, m.albedo[99 + 12], got.rgb[3 * 12 + 1]);
        }
        count++;
        picture_finish(&got);
    }
    /* white, albedo, error, 6 pairs of responses, clusters, the render */
    TEST_ASSERT_EQUAL_INT(17, count);
    store_decoded(last, "x.png");
    TEST_ASSERT_EQUAL_INT(NACRE_OK, picture_read(scratch_path("x.png"), &got, &error));
    TEST_ASSERT_EQUAL_INT(5, got.width);
    TEST_ASSERT_FLOAT_WITHIN(1.0f / 220, given.rgb[17], got.rgb[17]);
    picture_finish(&got);
    picture_finish(&given);
    nacre_material_finish(&m);
    free(page);
    free(pictures[0]);
}

static void expect_failure(const char *scan, const char *material, char *picture, const char *text)
{
    struct nacre_error error = {0};
    char *const pictures[] = {picture};
    int before = scratch_count();
    scratch_hush();
    int status = write_report(scan, material, pictures, picture ? 1 : 0, &error);
    scratch_hush_end();
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, text), error.text);
    TEST_ASSERT_EQUAL_INT(before, scratch_count()); /* no page, not even a part of one */
}

static void what_does_not_fit_together_is_refused(void)
{
    struct nacre_material m = made_material(paper);
    write_material("m.exr", &m);
    write_scan("s.exr", &m, 1, 99);
    struct nacre_material smaller = m;
    smaller.height = 8;
    write_scan("smaller.exr", &smaller, 1, 88);
    nacre_material_finish(&m);
    struct made_material grey = paper;
    grey.channels = grey.factor_channels = 1;
    m = made_material(grey);
    write_scan("grey.exr", &m, 1, 99);
    nacre_material_finish(&m);
    expect_failure("smaller.exr", "m.exr", NULL, "11 x 8");
    expect_failure("grey.exr", "m.exr", NULL, "channel");
    expect_failure("missing.exr", "m.exr", NULL, "missing.exr: cannot open");
    expect_failure("s.exr", "s.exr", NULL, "s.exr: ");
    expect_failure("m.exr", "m.exr", NULL, "m.exr: not a scan");
    char *picture = strdup(scratch_path("missing.png"));
    expect_failure("s.exr", "m.exr", picture, "missing.png");
    free(picture);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(page_tells_the_error_and_the_row_of_table_1);
    RUN_TEST(letters_stand_within_the_albedo);
    RUN_TEST(colours_of_the_cuts_are_told);
    RUN_TEST(every_layout_has_a_page);
    RUN_TEST(terms_are_shown_by_planes_kernels_and_shares);
    RUN_TEST(error_is_plotted_beside_the_objective);
    RUN_TEST(names_warnings_and_sources_are_escaped);
    RUN_TEST(convergence_is_plotted);
    RUN_TEST(points_that_were_not_measured_are_counted_apart);
    RUN_TEST(the_sample_is_shown_under_a_white_pattern);
    RUN_TEST(a_photograph_takes_the_place_of_the_white_pattern);
    RUN_TEST(images_are_whole_pngs);
    RUN_TEST(what_does_not_fit_together_is_refused);
    return UNITY_END();
}
