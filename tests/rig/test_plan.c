/* Tests of plan files: refusals, the order of patterns, what is drawn. */
#include "rig/plan.h"

#include "stage.h"
#include "tests/docs.h"
#include "unity.h"

#include <stdlib.h>
#include <string.h>

static struct nacre_error error;

void setUp(void)
{
    error.text[0] = '\0';
}

void tearDown(void)
{
}

static int read_text(const char *text, struct plan *plan)
{
    struct stage stage;
    stage_make(&stage, NULL, text);
    int status = plan_read(stage.plan, plan, &error);
    stage_remove(&stage);
    return status;
}

static void read_stage_plan(struct plan *plan)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, read_text(stage_plan, plan), error.text);
}

static void refuses(const char *from, const char *to, const char *what)
{
    struct plan plan;
    char *text = text_replace(stage_plan, from, to);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, read_text(text, &plan));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, what), error.text);
    TEST_ASSERT_NULL(plan.exposure_turns);
    free(text);
}

static void plan_of_the_documentation_is_read(void)
{
    struct plan plan;
    char *text = docs_example("formats.md", "plan.yaml");
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, read_text(text, &plan), error.text);
    TEST_ASSERT_EQUAL_INT(25, plan.grid_spacing);
    TEST_ASSERT_EQUAL_INT(625, plan_pattern_count(&plan, PATTERN_GRID));
    TEST_ASSERT_EQUAL_INT(9, plan_pattern_count(&plan, PATTERN_DOTS));
    TEST_ASSERT_EQUAL_INT(4, plan.exposure_count);
    TEST_ASSERT_EQUAL_DOUBLE(15, plan.exposure_turns[2]);
    plan_finish(&plan);
    free(text);
}

static void plan_refuses_what_cannot_be_measured(void)
{
    refuses("window: 3", "window: 2", "is even; use 1 or 3");
    refuses("window: 3", "window: 5", "wider than grid_spacing 3");
    refuses("dot_size: 1", "dot_size: 4", "must be above dot_size 4");
    refuses("dot_shift: 2", "dot_shift: 5", "not below dot_shift 5");
    refuses("[1, 3]", "[3, 1]", "1 follows 3");
    refuses("[1, 3]", "[1, 1]", "1 follows 1");
    refuses("[1, 3]", "[]", "exposure_turns");
    refuses("[1, 3]", "[0, 3]", "exposure_turns");
    refuses("grid_spacing: 3", "grid_spacing: 0", "grid_spacing");
    refuses("black_frames: 2", "black_frames: 0", "black_frames");
}

static void plan_messages_name_line_and_column(void)
{
    refuses("dot_size: 1", "dot_sise: 1", "plan.yaml:6:1: ");
    refuses("window: 3", "window: 2", "plan.yaml:8: ");
}

static int compare_patterns(const void *a, const void *b)
{
    const struct pattern *first = a;
    const struct pattern *second = b;
    return first->kind != second->kind ? (int)first->kind - (int)second->kind
                                       : first->number - second->number;
}

static void order_shows_every_pattern_once(void)
{
    struct plan plan;
    struct pattern *patterns;
    size_t count, i = 0;
    read_stage_plan(&plan);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&plan, &patterns, &count, &error));
    TEST_ASSERT_EQUAL_INT(STAGE_PATTERNS, count);
    qsort(patterns, count, sizeof *patterns, compare_patterns);
    for (int kind = 0; kind < PATTERN_KINDS; kind++) {
        for (int n = 0; n < plan_pattern_count(&plan, (enum pattern_kind)kind); n++, i++) {
            TEST_ASSERT_EQUAL_INT(kind, patterns[i].kind);
            TEST_ASSERT_EQUAL_INT(n, patterns[i].number);
        }
    }
    TEST_ASSERT_EQUAL_INT(count, i);
    free(patterns);
    plan_finish(&plan);
}

static void pilot_shows_a_random_choice_of_grids(void)
{
    struct plan plan;
    struct pattern *all;
    struct pattern *some;
    size_t count;
    size_t fewer;
    read_stage_plan(&plan);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&plan, &all, &count, &error));
    plan.grid_patterns = 3;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&plan, &some, &fewer, &error));
    TEST_ASSERT_EQUAL_INT(3, plan_shown_count(&plan, PATTERN_GRID));
    TEST_ASSERT_EQUAL_INT(9, plan_pattern_count(&plan, PATTERN_GRID));
    TEST_ASSERT_EQUAL_UINT(count - 6, fewer);
    for (size_t i = 0; i < fewer; i++) {
        TEST_ASSERT_EQUAL_INT(all[i].kind, some[i].kind);
        TEST_ASSERT_EQUAL_INT(all[i].number, some[i].number);
    }
    plan.grid_patterns = 1000; /* more than there are */
    TEST_ASSERT_EQUAL_INT(9, plan_shown_count(&plan, PATTERN_GRID));
    free(all);
    free(some);
    plan_finish(&plan);
}

static void order_changes_the_white_layer_once(void)
{
    struct plan plan;
    struct pattern *patterns;
    size_t count;
    int changes = 0;
    read_stage_plan(&plan);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&plan, &patterns, &count, &error));
    TEST_ASSERT_TRUE(pattern_kind_wants_white_layer(patterns[0].kind));
    for (size_t i = 1; i < count; i++) {
        changes += pattern_kind_wants_white_layer(patterns[i].kind) !=
                   pattern_kind_wants_white_layer(patterns[i - 1].kind);
    }
    TEST_ASSERT_EQUAL_INT(1, changes);
    free(patterns);
    plan_finish(&plan);
}

static void order_depends_on_the_seed_alone(void)
{
    struct plan plan;
    struct pattern *first, *again, *other;
    size_t count;
    read_stage_plan(&plan);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&plan, &first, &count, &error));
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&plan, &again, &count, &error));
    plan.seed++;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&plan, &other, &count, &error));
    TEST_ASSERT_EQUAL_MEMORY(first, again, count * sizeof *first);
    TEST_ASSERT_TRUE(memcmp(first, other, count * sizeof *first) != 0);
    free(first);
    free(again);
    free(other);
    plan_finish(&plan);
}

static void sequential_order_shows_the_grids_by_number(void)
{
    struct plan plan;
    struct pattern *patterns;
    size_t count;
    read_stage_plan(&plan);
    TEST_ASSERT_EQUAL_INT(GRID_ORDER_RANDOM, plan.order);
    plan.order = GRID_ORDER_SEQUENTIAL;
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&plan, &patterns, &count, &error));
    for (int i = 0; i < STAGE_GRIDS; i++) {
        TEST_ASSERT_EQUAL_INT(i, patterns[count - STAGE_GRIDS + (size_t)i].number);
    }
    free(patterns);
    plan_finish(&plan);
}

/* The order is part of the contract between versions and machines: these numbers were written down when it was made. */
static void order_of_a_seed_stays_for_ever(void)
{
    static const int expected[STAGE_GRIDS] = {4, 2, 8, 3, 7, 5, 6, 1, 0};
    struct plan plan;
    struct pattern *patterns;
    size_t count;
    read_stage_plan(&plan);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, plan_order(&plan, &patterns, &count, &error));
    for (int i = 0; i < STAGE_GRIDS; i++) {
        TEST_ASSERT_EQUAL_INT(expected[i], patterns[count - STAGE_GRIDS + (size_t)i].number);
    }
    free(patterns);
    plan_finish(&plan);
}

static void grids_light_every_point_exactly_once(int width, int height, int spacing)
{
    struct plan plan = {.grid_spacing = spacing};
    uint8_t levels[64];
    int lit[64] = {0};
    for (int n = 0; n < plan_pattern_count(&plan, PATTERN_GRID); n++) {
        struct pattern pattern = {PATTERN_GRID, n};
        int x0, y0;
        plan_pattern_offset(&plan, pattern, &x0, &y0);
        plan_draw(&plan, pattern, width, height, levels);
        for (int i = 0; i < width * height; i++) {
            int x = i % width, y = i / width;
            bool expected =
                x >= x0 && y >= y0 && (x - x0) % spacing == 0 && (y - y0) % spacing == 0;
            TEST_ASSERT_EQUAL_INT(expected ? 255 : 0, levels[i]);
            lit[i] += levels[i] == 255;
        }
    }
    for (int i = 0; i < width * height; i++) {
        TEST_ASSERT_EQUAL_INT(1, lit[i]);
    }
}

static void grids_cover_the_sample_for_awkward_sizes(void)
{
    grids_light_every_point_exactly_once(6, 6, 3);
    grids_light_every_point_exactly_once(7, 5, 3);
    grids_light_every_point_exactly_once(1, 8, 3);
    grids_light_every_point_exactly_once(3, 2, 5); /* wider than the sample: some grids are dark */
    grids_light_every_point_exactly_once(4, 4, 1);
}

static void white_lights_all_and_black_nothing(void)
{
    struct plan plan = {.grid_spacing = 3};
    uint8_t levels[6];
    plan_draw(&plan, (struct pattern){PATTERN_WHITE, 0}, 3, 2, levels);
    TEST_ASSERT_EACH_EQUAL_UINT8(255, levels, 6);
    plan_draw(&plan, (struct pattern){PATTERN_BLACK, 0}, 3, 2, levels);
    TEST_ASSERT_EACH_EQUAL_UINT8(0, levels, 6);
}

static void dots_that_the_border_cuts_are_left_out(void)
{
    struct plan plan = {.dot_spacing = 4, .dot_shift = 3, .dot_size = 2};
    uint8_t levels[6 * 5];
    static const uint8_t expected[6 * 5] = {
        0, 0, 0, 0, 0, 0, /* a dot at (3, 3); the one at (7, 3) is outside */
        0, 0, 0, 0, 0, 0, /**/
        0, 0, 0, 0, 0, 0, /**/
        0, 0, 0, 1, 1, 0, /**/
        0, 0, 0, 1, 1, 0};
    TEST_ASSERT_EQUAL_INT(4, plan_pattern_count(&plan, PATTERN_DOTS));
    plan_draw(&plan, (struct pattern){PATTERN_DOTS, 3}, 6, 5, levels);
    for (int i = 0; i < 30; i++) {
        TEST_ASSERT_EQUAL_INT(expected[i] * 255, levels[i]);
    }
    plan_draw(&plan, (struct pattern){PATTERN_DOTS, 3}, 6, 4, levels); /* now row 4 is cut off */
    TEST_ASSERT_EACH_EQUAL_UINT8(0, levels, 24);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(plan_of_the_documentation_is_read);
    RUN_TEST(plan_refuses_what_cannot_be_measured);
    RUN_TEST(plan_messages_name_line_and_column);
    RUN_TEST(order_shows_every_pattern_once);
    RUN_TEST(pilot_shows_a_random_choice_of_grids);
    RUN_TEST(order_changes_the_white_layer_once);
    RUN_TEST(order_depends_on_the_seed_alone);
    RUN_TEST(sequential_order_shows_the_grids_by_number);
    RUN_TEST(order_of_a_seed_stays_for_ever);
    RUN_TEST(grids_cover_the_sample_for_awkward_sizes);
    RUN_TEST(white_lights_all_and_black_nothing);
    RUN_TEST(dots_that_the_border_cuts_are_left_out);
    return UNITY_END();
}
