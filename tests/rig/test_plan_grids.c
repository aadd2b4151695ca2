/* Tests of which points each grid lights, and of plans with regions. */
#include "rig/plan.h"
#include "stage.h"
#include "unity.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { WIDTH = 37, HEIGHT = 29 };

static struct nacre_error error;
static struct plan plan;

void setUp(void)
{
    error.text[0] = '\0';
}

void tearDown(void)
{
    plan_finish(&plan);
}

static int read_plan(const char *more)
{
    char text[2048];
    (void)snprintf(text, sizeof text,
                   "grid_spacing: 8\nwindow: 5\nexposure_turns: [1, 4, 15, 60]\n%s", more);
    int status = plan_parse("plan.yaml", text, strlen(text), &plan, &error);
    return status == NACRE_OK ? plan_lay(&plan, "plan.yaml", WIDTH, HEIGHT, 3, &error) : status;
}

static void must_read(const char *more)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, read_plan(more), error.text);
}

static void refuses(const char *more, const char *what)
{
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, read_plan(more));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, what), error.text);
    plan_finish(&plan);
}

static const char regions[] =
    "regions:\n"
    "  - {x: 0, y: 0, width: 20, height: 29, spacing: 5, longest_turns: 15}\n"
    "  - {x: 10, y: 4, width: 6, height: 9, spacing: 11}\n";

/* Every point once; two in one grid the mean of their spacings apart. */
static void check_grids(void)
{
    const struct plan_grids *grids = plan.grids;
    int lit[WIDTH * HEIGHT] = {0};
    for (int g = 0; g < grids->count; g++) {
        for (uint32_t i = grids->starts[g]; i < grids->starts[g + 1]; i++) {
            int p = (int)grids->points[i];
            lit[p]++;
            TEST_ASSERT_EQUAL_INT(g, grids->grid_of[p]);
            TEST_ASSERT_EQUAL_INT(i, grids->places[p]);
            for (uint32_t j = grids->starts[g]; j < i; j++) {
                int q = (int)grids->points[j];
                int across = abs(p % WIDTH - q % WIDTH);
                int down = abs(p / WIDTH - q / WIDTH);
                int apart = across > down ? across : down;
                TEST_ASSERT_TRUE(2 * apart >= grids->spacings[p] + grids->spacings[q]);
            }
        }
    }
    for (int p = 0; p < WIDTH * HEIGHT; p++) {
        TEST_ASSERT_EQUAL_INT(1, lit[p]);
    }
}

static void one_spacing_is_a_lattice(void)
{
    must_read("");
    TEST_ASSERT_EQUAL_INT(64, plan.grids->count);
    TEST_ASSERT_EQUAL_INT(64, plan_pattern_count(&plan, PATTERN_GRID));
    for (int p = 0; p < WIDTH * HEIGHT; p++) {
        TEST_ASSERT_EQUAL_INT(p / WIDTH % 8 * 8 + p % WIDTH % 8, plan.grids->grid_of[p]);
    }
    check_grids();
}

static void regions_keep_their_spacings(void)
{
    must_read(regions);
    TEST_ASSERT_EQUAL_INT(5, plan.grids->spacings[0]);
    TEST_ASSERT_EQUAL_INT(11, plan.grids->spacings[4 * WIDTH + 10]);
    TEST_ASSERT_EQUAL_INT(11, plan.grids->spacings[12 * WIDTH + 15]);
    TEST_ASSERT_EQUAL_INT(5, plan.grids->spacings[13 * WIDTH + 15]);
    TEST_ASSERT_EQUAL_INT(8, plan.grids->spacings[20]);
    check_grids();
    /* No more grids than the lattice of the widest spacing has. */
    TEST_ASSERT_TRUE(plan.grids->count <= 121);
}

static void grids_are_drawn_point_by_point(void)
{
    enum { WIDER = WIDTH + 5 };
    static uint8_t levels[WIDER * HEIGHT];
    must_read(regions);
    for (int g = 0; g < plan.grids->count; g += 7) {
        plan_draw(&plan, (struct pattern){PATTERN_GRID, g}, WIDER, HEIGHT, levels);
        for (int i = 0; i < WIDER * HEIGHT; i++) {
            int x = i % WIDER;
            int y = i / WIDER;
            bool lit = x < WIDTH && plan.grids->grid_of[y * WIDTH + x] == (uint32_t)g;
            TEST_ASSERT_EQUAL_INT(lit ? 255 : 0, levels[i]);
        }
    }
}

static void a_grid_is_exposed_as_its_neediest_point_asks(void)
{
    size_t fewer = 0;
    must_read("regions: [{x: 0, y: 0, width: 37, height: 14, spacing: 5, longest_turns: 15}]\n");
    for (int g = 0; g < plan.grids->count; g++) {
        size_t needed = 1;
        for (uint32_t i = plan.grids->starts[g]; i < plan.grids->starts[g + 1]; i++) {
            size_t own = plan.grids->points[i] / WIDTH < 14 ? 3 : 4;
            needed = own > needed ? own : needed;
        }
        TEST_ASSERT_EQUAL_UINT(needed,
                               plan_pattern_exposures(&plan, (struct pattern){PATTERN_GRID, g}));
        fewer += needed < 4;
    }
    TEST_ASSERT_EQUAL_UINT(0, fewer); /* the wide region has points in each */
    TEST_ASSERT_EQUAL_UINT(4, plan_pattern_exposures(&plan, (struct pattern){PATTERN_BLACK, 0}));
    plan_finish(&plan);
    must_read("regions: [{x: 0, y: 0, width: 37, height: 14, spacing: 11, longest_turns: 4}]\n");
    for (int g = 0; g < plan.grids->count; g++) {
        fewer += plan_pattern_exposures(&plan, (struct pattern){PATTERN_GRID, g}) == 2;
    }
    /* Each of the 8 x 8 lattice's grids has needy points; where the wide region blocks them, others have, too, but not all. */
    TEST_ASSERT_TRUE(fewer > 0 && fewer <= 121 - 64);
}

static void settings_are_written_and_read_back(void)
{
    char *text = NULL;
    size_t size = 0;
    char where[64];
    struct plan again;
    must_read("regions: [{x: 1, y: 2, width: 3, height: 4, spacing: 9, longest_turns: 4}]\n"
              "profile: [1, 0.25, 0.5, 0.125, 4, 2]\n");
    TEST_ASSERT_EQUAL_INT(NACRE_OK, settings_text(&plan_schema, &plan, &text, &size, &error));
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, plan_parse("again", text, size, &again, &error),
                                  error.text);
    TEST_ASSERT_TRUE(settings_same(&plan_schema, &plan, &again, where, sizeof where));
    TEST_ASSERT_EQUAL_INT(1, again.region_count);
    TEST_ASSERT_EQUAL_INT(6, again.profile_count);
    again.regions[0].spacing = 10;
    TEST_ASSERT_FALSE(settings_same(&plan_schema, &plan, &again, where, sizeof where));
    plan_finish(&again);
    free(text);
}

static void regions_that_cannot_be_measured_are_refused(void)
{
    refuses("regions: [{x: 30, y: 0, width: 8, height: 2, spacing: 9}]\n",
            "reach out of the sample");
    refuses("regions: [{x: 0, y: 0, width: 8, height: 2, spacing: 3}]\n",
            "window 5 is wider than the spacing 3");
    refuses("regions: [{x: 0, y: 0, width: 0, height: 2, spacing: 9}]\n", "plan.yaml:4:");
    refuses("profile: [1, 0.5, 0.2, 0.1]\n", "as many for each of 3 colours");
    refuses("profile: [1, 0, 0.2, 0.1, 1, 1]\n", "profile");
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(one_spacing_is_a_lattice);
    RUN_TEST(regions_keep_their_spacings);
    RUN_TEST(grids_are_drawn_point_by_point);
    RUN_TEST(a_grid_is_exposed_as_its_neediest_point_asks);
    RUN_TEST(settings_are_written_and_read_back);
    RUN_TEST(regions_that_cannot_be_measured_are_refused);
    return UNITY_END();
}
