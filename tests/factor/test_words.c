/* Sizes in words. */
#include "factor/words.h"
#include "unity.h"

void setUp(void)
{
}

void tearDown(void)
{
}

static void one_is_singular_and_no_clusters_are_not_told(void)
{
    TEST_ASSERT_EQUAL_STRING("1 term", size_words(1, 0).text);
    TEST_ASSERT_EQUAL_STRING("8 terms", size_words(8, 0).text);
    TEST_ASSERT_EQUAL_STRING("1 term, 100 clusters", size_words(1, 100).text);
    TEST_ASSERT_EQUAL_STRING("12 terms, 1 cluster", size_words(12, 1).text);
    TEST_ASSERT_EQUAL_STRING("2147483647 terms, 2147483647 clusters",
                             size_words(2147483647, 2147483647).text);
}

static void ratios_are_the_papers_and_never_nought(void)
{
    TEST_ASSERT_EQUAL_STRING("1/69", ratio_words(69, 1).text);
    TEST_ASSERT_EQUAL_STRING("1/10", ratio_words(9.5, 1).text);
    TEST_ASSERT_EQUAL_STRING("1/9.4", ratio_words(9.4, 1).text);
    TEST_ASSERT_EQUAL_STRING("1.0/1", ratio_words(1, 1).text);
    TEST_ASSERT_EQUAL_STRING("2.2/1", ratio_words(1, 2.2).text);
    TEST_ASSERT_EQUAL_STRING("300/1", ratio_words(1, 300).text);
    TEST_ASSERT_EQUAL_STRING("1/10000000000", ratio_words(1e10, 1).text);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(one_is_singular_and_no_clusters_are_not_told);
    RUN_TEST(ratios_are_the_papers_and_never_nought);
    return UNITY_END();
}
