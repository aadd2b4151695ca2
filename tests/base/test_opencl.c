/* Tests of choosing an OpenCL device and of building and running embedded kernels. */
#include "base/opencl_programs.h"
#include "tests/files.h"
#include "unity.h"

#include <ctype.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

extern const struct opencl_source sum_cl;

enum { COUNT = 1031 }; /* a prime, so no multiple of a work group */

static char *folder;

void setUp(void)
{
    folder = folder_make();
    TEST_ASSERT_EQUAL_INT(0, unsetenv("NACRE_CL_DIR"));
    TEST_ASSERT_EQUAL_INT(0, unsetenv("NACRE_DEVICE"));
}

void tearDown(void)
{
    folder_remove(folder);
}

static void open_device(const char *selector, struct opencl *opencl)
{
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT_MESSAGE(NACRE_OK, opencl_open(selector, opencl, &error), error.text);
}

static void expect_no_device(const char *selector, const char *text)
{
    struct opencl opencl;
    struct nacre_error error = {""};
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, opencl_open(selector, &opencl, &error));
    TEST_ASSERT_EQUAL_STRING(text, error.text);
    TEST_ASSERT_NULL(opencl.context);
    opencl_close(&opencl);
}

/* Must come first: the loader looks for drivers once in a process. */
static void without_a_driver_the_error_says_what_to_install(void)
{
    int status = 0;
    (void)fflush(stdout);
    pid_t child = fork();
    TEST_ASSERT_TRUE(child >= 0);
    if (child == 0) {
        struct opencl opencl;
        struct nacre_error error = {""};
        (void)setenv("OCL_ICD_VENDORS", "/nonexistent", 1);
        bool right = opencl_list(NULL, 0) == 0 &&
                     opencl_open(NULL, &opencl, &error) == NACRE_FAILED &&
                     strstr(error.text, "pocl-opencl-icd");
        _exit(right ? 0 : 1);
    }
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    TEST_ASSERT_TRUE(WIFEXITED(status));
    TEST_ASSERT_EQUAL_INT(0, WEXITSTATUS(status));
}

static void a_device_opens_without_being_chosen(void)
{
    struct opencl opencl;
    open_device(NULL, &opencl);
    TEST_ASSERT_NOT_NULL(opencl.context);
    TEST_ASSERT_NOT_NULL(opencl.queue);
    TEST_ASSERT_TRUE(opencl.compute_units > 0);
    TEST_ASSERT_TRUE(opencl.name[0] != '\0');
    opencl_close(&opencl);
    TEST_ASSERT_NULL(opencl.context);
    opencl_close(&opencl); /* a zeroed one */
    open_device("", &opencl);
    opencl_close(&opencl);
}

static void a_device_is_chosen_by_its_number(void)
{
    struct opencl opencl;
    cl_device_id devices[64];
    size_t count = opencl_list(devices, 64);
    TEST_ASSERT_TRUE(count >= 1 && count <= 64);
    char last[16];
    (void)snprintf(last, sizeof last, "%zu", count - 1);
    open_device(last, &opencl);
    TEST_ASSERT_EQUAL_PTR(devices[count - 1], opencl.device);
    opencl_close(&opencl);
    (void)snprintf(last, sizeof last, "%zu", count);
    char text[160];
    (void)snprintf(text, sizeof text,
                   "--device: no OpenCL device is called '%s'; `nacre devices` lists them", last);
    expect_no_device(last, text);
    expect_no_device("-1", "--device: no OpenCL device is called '-1'; `nacre devices` lists them");
    expect_no_device("99999999999999999999", "--device: no OpenCL device is called "
                                             "'99999999999999999999'; `nacre devices` lists them");
}

static void a_device_is_chosen_by_part_of_its_name_in_any_case(void)
{
    struct opencl first, chosen;
    open_device("0", &first);
    char part[64];
    (void)snprintf(part, sizeof part, "%s", first.name + (strlen(first.name) > 4));
    for (char *c = part; *c; c++) {
        *c = (char)toupper((unsigned char)*c);
    }
    open_device(part, &chosen);
    TEST_ASSERT_EQUAL_PTR(first.device, chosen.device);
    opencl_close(&first);
    opencl_close(&chosen);
    expect_no_device("abacus",
                     "--device: no OpenCL device is called 'abacus'; `nacre devices` lists them");
}

static void the_environment_chooses_where_the_option_does_not(void)
{
    struct opencl opencl;
    TEST_ASSERT_EQUAL_INT(0, setenv("NACRE_DEVICE", "abacus", 1));
    expect_no_device(NULL, "NACRE_DEVICE: no OpenCL device is called 'abacus'; `nacre devices` "
                           "lists them");
    expect_no_device(
        "", "NACRE_DEVICE: no OpenCL device is called 'abacus'; `nacre devices` lists them");
    open_device("0", &opencl); /* the option wins */
    opencl_close(&opencl);
    TEST_ASSERT_EQUAL_INT(0, setenv("NACRE_DEVICE", "0", 1));
    open_device(NULL, &opencl);
    opencl_close(&opencl);
    TEST_ASSERT_EQUAL_INT(0, setenv("NACRE_DEVICE", "", 1));
    open_device(NULL, &opencl);
    opencl_close(&opencl);
}

/* c = a + factor b on the device by the kernel `sum` of a program. */
static void run_sum(const struct opencl *opencl, cl_program program, const float *a, const float *b,
                    float *c)
{
    cl_int status = CL_SUCCESS, count = COUNT;
    size_t size = COUNT * sizeof *a, items = 1088;
    cl_mem buffers[3];
    cl_kernel kernel = clCreateKernel(program, "sum", &status);
    TEST_ASSERT_EQUAL_INT(CL_SUCCESS, status);
    for (cl_uint i = 0; i < 3; i++) {
        buffers[i] = clCreateBuffer(opencl->context, CL_MEM_READ_WRITE, size, NULL, &status);
        TEST_ASSERT_EQUAL_INT(CL_SUCCESS, status);
        TEST_ASSERT_EQUAL_INT(CL_SUCCESS, clSetKernelArg(kernel, i, sizeof(cl_mem), &buffers[i]));
    }
    TEST_ASSERT_EQUAL_INT(CL_SUCCESS, clSetKernelArg(kernel, 3, sizeof count, &count));
    TEST_ASSERT_EQUAL_INT(CL_SUCCESS, clEnqueueWriteBuffer(opencl->queue, buffers[0], CL_TRUE, 0,
                                                           size, a, 0, NULL, NULL));
    TEST_ASSERT_EQUAL_INT(CL_SUCCESS, clEnqueueWriteBuffer(opencl->queue, buffers[1], CL_TRUE, 0,
                                                           size, b, 0, NULL, NULL));
    TEST_ASSERT_EQUAL_INT(CL_SUCCESS, clEnqueueNDRangeKernel(opencl->queue, kernel, 1, NULL, &items,
                                                             NULL, 0, NULL, NULL));
    TEST_ASSERT_EQUAL_INT(CL_SUCCESS, clEnqueueReadBuffer(opencl->queue, buffers[2], CL_TRUE, 0,
                                                          size, c, 0, NULL, NULL));
    for (int i = 0; i < 3; i++) {
        (void)clReleaseMemObject(buffers[i]);
    }
    (void)clReleaseKernel(kernel);
}

/* Build sum.cl with `options` and compare what it computes with a + factor b. */
static void expect_sum(const char *options, float factor)
{
    float a[COUNT], b[COUNT], c[COUNT];
    struct opencl opencl;
    cl_program program = NULL;
    struct nacre_error error = {""};
    for (int i = 0; i < COUNT; i++) {
        a[i] = (float)i;
        b[i] = (float)(3 * i - 100);
    }
    open_device(NULL, &opencl);
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        NACRE_OK, opencl_build(&opencl, &sum_cl, options, &program, &error), error.text);
    run_sum(&opencl, program, a, b, c);
    for (int i = 0; i < COUNT; i++) {
        TEST_ASSERT_EQUAL_FLOAT(a[i] + factor * b[i], c[i]); /* small integers: exact */
    }
    (void)clReleaseProgram(program);
    opencl_close(&opencl);
}

static void an_embedded_kernel_builds_and_computes(void)
{
    expect_sum(NULL, 1);
    expect_sum("-DFACTOR=4", 4);
}

/* The compiler is asked once for each choice of options. */
static void what_was_built_is_not_built_again(void)
{
    struct opencl opencl;
    struct nacre_error error = {""};
    cl_program programs[3] = {NULL};
    static const char *const options[] = {"-DFACTOR=2", "-DFACTOR=3", "-DFACTOR=2"};
    open_device(NULL, &opencl);
    for (int i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_INT(NACRE_OK,
                              opencl_build(&opencl, &sum_cl, options[i], &programs[i], &error));
    }
    TEST_ASSERT_TRUE(programs[0] != programs[1]);
    TEST_ASSERT_EQUAL_PTR(programs[0], programs[2]);
    for (int i = 0; i < 3; i++) {
        (void)clReleaseProgram(programs[i]);
    }
    opencl_close(&opencl);
}

/* One that makes room for others serves whoever holds it; of others the latest are found. */
static void the_oldest_program_makes_room(void)
{
    struct opencl opencl;
    struct nacre_error error = {""};
    cl_program program = NULL;
    char options[16];
    open_device(NULL, &opencl);
    TEST_ASSERT_EQUAL_INT(NACRE_OK, opencl_build(&opencl, &sum_cl, "", &program, &error));
    for (int i = 0; i < OPENCL_PROGRAMS_KEPT; i++) {
        (void)snprintf(options, sizeof options, "%d", i);
        opencl_programs_keep(opencl.programs, &sum_cl, options, program);
    }
    TEST_ASSERT_NULL(opencl_programs_find(opencl.programs, &sum_cl, ""));
    for (int i = 0; i < OPENCL_PROGRAMS_KEPT; i++) {
        (void)snprintf(options, sizeof options, "%d", i);
        TEST_ASSERT_EQUAL_PTR(program, opencl_programs_find(opencl.programs, &sum_cl, options));
        (void)clReleaseProgram(program);
    }
    float a[COUNT] = {0}, b[COUNT] = {5}, c[COUNT];
    run_sum(&opencl, program, a, b, c);
    TEST_ASSERT_EQUAL_FLOAT(5, c[0]);
    (void)clReleaseProgram(program);
    opencl_close(&opencl);
}

/* Build `source` and expect it to fail; the error's text is left in *error. */
static void expect_build_failure(const struct opencl_source *source, const char *options,
                                 struct nacre_error *error)
{
    struct opencl opencl;
    cl_program program = NULL;
    open_device(NULL, &opencl);
    int result = opencl_build(&opencl, source, options, &program, error);
    opencl_close(&opencl);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED, result);
    TEST_ASSERT_NULL(program);
}

static void a_kernel_that_does_not_compile_is_reported_with_file_and_line(void)
{
    struct nacre_error error = {""};
    expect_build_failure(&sum_cl, "-DFACTOR=undeclared", &error);
    TEST_ASSERT_EQUAL_STRING_LEN("cannot build sum.cl: CL_BUILD_PROGRAM_FAILURE on ", error.text,
                                 49);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "sum.cl:10:"), error.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "undeclared"), error.text);
    static const char *const lines[] = {"#line 1 \"two.cl\"\n", "\n", "kernel void f( {\n"};
    static const struct opencl_source two = {"two.cl", lines, 3};
    expect_build_failure(&two, NULL, &error);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "two.cl:2:"), error.text);
}

static void write_override(const char *text)
{
    char *path = path_join(folder, "sum.cl");
    text_write(path, text);
    free(path);
    TEST_ASSERT_EQUAL_INT(0, setenv("NACRE_CL_DIR", folder, 1));
}

static void a_file_in_nacre_cl_dir_replaces_the_embedded_kernel(void)
{
    write_override("kernel void sum(global const float *a, global const float *b,\n"
                   "                global float *c, const int count)\n"
                   "{\n"
                   "    const int i = get_global_id(0);\n"
                   "    if (i < count) c[i] = a[i] - 7 * b[i];\n"
                   "}\n");
    expect_sum(NULL, -7);
}

static void a_broken_file_in_nacre_cl_dir_is_named_with_its_path(void)
{
    struct nacre_error error = {""};
    char place[PATH_MAX + 16];
    write_override("\n\nkernel void sum(;\n");
    (void)snprintf(place, sizeof place, "%s/sum.cl:3:", folder);
    expect_build_failure(&sum_cl, NULL, &error);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, place), error.text);
}

static void a_kernel_that_nacre_cl_dir_lacks_is_the_embedded_one(void)
{
    TEST_ASSERT_EQUAL_INT(0, setenv("NACRE_CL_DIR", folder, 1));
    expect_sum(NULL, 1);
}

static void a_nacre_cl_dir_that_is_not_there_is_refused(void)
{
    struct nacre_error error = {""};
    char path[PATH_MAX + 16], text[PATH_MAX + 128];
    (void)snprintf(path, sizeof path, "%s/none", folder);
    TEST_ASSERT_EQUAL_INT(0, setenv("NACRE_CL_DIR", path, 1));
    expect_build_failure(&sum_cl, NULL, &error);
    (void)snprintf(text, sizeof text, "NACRE_CL_DIR: cannot use %s: No such file or directory",
                   path);
    TEST_ASSERT_EQUAL_STRING(text, error.text);
    (void)snprintf(path, sizeof path, "%s/sum.cl", folder);
    TEST_ASSERT_EQUAL_INT(0, setenv("NACRE_CL_DIR", folder, 1));
    TEST_ASSERT_EQUAL_INT(0, system("mkdir \"$NACRE_CL_DIR/sum.cl\"")); /* NOLINT(cert-env33-c) */
    expect_build_failure(&sum_cl, NULL, &error);
    (void)snprintf(text, sizeof text, "NACRE_CL_DIR: cannot read %s: Is a directory", path);
    TEST_ASSERT_EQUAL_STRING(text, error.text);
}

static void statuses_become_errors_with_name_and_device(void)
{
    const struct opencl opencl = {.name = "abacus"};
    struct nacre_error error = {"untouched"};
    TEST_ASSERT_EQUAL_INT(NACRE_OK, opencl_check(&opencl, CL_SUCCESS, "summing", &error));
    TEST_ASSERT_EQUAL_STRING("untouched", error.text);
    TEST_ASSERT_EQUAL_INT(NACRE_FAILED,
                          opencl_check(&opencl, CL_OUT_OF_RESOURCES, "summing", &error));
    TEST_ASSERT_EQUAL_STRING("summing: CL_OUT_OF_RESOURCES on abacus", error.text);
    TEST_ASSERT_EQUAL_STRING("an unknown OpenCL status", opencl_status_name(-7777));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(without_a_driver_the_error_says_what_to_install);
    RUN_TEST(a_device_opens_without_being_chosen);
    RUN_TEST(a_device_is_chosen_by_its_number);
    RUN_TEST(a_device_is_chosen_by_part_of_its_name_in_any_case);
    RUN_TEST(the_environment_chooses_where_the_option_does_not);
    RUN_TEST(an_embedded_kernel_builds_and_computes);
    RUN_TEST(what_was_built_is_not_built_again);
    RUN_TEST(the_oldest_program_makes_room);
    RUN_TEST(a_kernel_that_does_not_compile_is_reported_with_file_and_line);
    RUN_TEST(a_file_in_nacre_cl_dir_replaces_the_embedded_kernel);
    RUN_TEST(a_broken_file_in_nacre_cl_dir_is_named_with_its_path);
    RUN_TEST(a_kernel_that_nacre_cl_dir_lacks_is_the_embedded_one);
    RUN_TEST(a_nacre_cl_dir_that_is_not_there_is_refused);
    RUN_TEST(statuses_become_errors_with_name_and_device);
    return UNITY_END();
}
