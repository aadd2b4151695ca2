/* Tests of the lab itself: what other tests take for granted of the guest. */
#include "gpio_sim.h"
#include "guest.h"
#include "unity.h"

#include <stdio.h>
#include <stdlib.h>
#include <sys/utsname.h>
#include <unistd.h>

void setUp(void)
{
}

void tearDown(void)
{
}

static void guest_is_root_on_a_kernel_of_its_own(void)
{
    struct utsname name;
    TEST_ASSERT_EQUAL_INT(0, uname(&name));
    TEST_ASSERT_EQUAL_INT(0, geteuid());
    TEST_ASSERT_EQUAL_STRING(getenv("LAB_RELEASE"), name.release);
}

static void files_of_the_host_can_be_written_over(void)
{
    guest_write("/etc/hostname", "guest\n");
    TEST_ASSERT_EQUAL_STRING("guest", guest_read("/etc/hostname"));
}

static void gpio_chip_comes_and_goes(void)
{
    static const char *const names[] = {"first", "second", NULL};
    struct gpio_sim chip = gpio_sim_plug("chip", 4, names);
    char path[64];
    (void)snprintf(path, sizeof path, "%s", chip.path);
    gpio_sim_unplug(&chip);
    guest_wait_for(path, false);
}

static void gpio_line_follows_its_pull(void)
{
    struct gpio_sim chip = gpio_sim_plug("chip", 4, NULL);
    TEST_ASSERT_EQUAL_INT(0, gpio_sim_level(&chip, 3));
    gpio_sim_pull(&chip, 3, 1);
    TEST_ASSERT_EQUAL_INT(1, gpio_sim_level(&chip, 3));
    TEST_ASSERT_EQUAL_INT(0, gpio_sim_level(&chip, 2));
    gpio_sim_unplug(&chip);
}

int main(void)
{
    guest_require();
    UNITY_BEGIN();
    RUN_TEST(guest_is_root_on_a_kernel_of_its_own);
    RUN_TEST(files_of_the_host_can_be_written_over);
    RUN_TEST(gpio_chip_comes_and_goes);
    RUN_TEST(gpio_line_follows_its_pull);
    return UNITY_END();
}
