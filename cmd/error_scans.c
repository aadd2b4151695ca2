/* nacre error with two scans: how far one is from the other. */
#include "cmd/error_scans.h"

#include "cmd/json_print.h"
#include "nacre/scan.h"
#include "study/difference.h"

#include <jansson.h>
#include <stdio.h>

bool error_is_scan(const char *path)
{
    struct nacre_scan *scan = NULL;
    struct nacre_error ignored;
    bool found = nacre_scan_open(path, &scan, &ignored) == NACRE_OK;
    nacre_scan_close(scan);
    return found;
}

static int print_difference(const struct scan_difference *difference, bool json,
                            struct nacre_error *error)
{
    if (json) {
        return json_print(json_pack("{s:I, s:I, s:f, s:f, s:f, s:f}", "points",
                                    (json_int_t)difference->points, "left_out",
                                    (json_int_t)difference->left_out, "min", difference->least,
                                    "mean", difference->mean, "max", difference->greatest, "bias",
                                    difference->bias),
                          error);
    }
    (void)printf("%-10s %zu compared, %zu left out\n", "points", difference->points,
                 difference->left_out);
    (void)printf("%-10s min %.4g, mean %.4g, max %.4g of a response; its sum is off by %.3g on "
                 "average\n",
                 "error", difference->least, difference->mean, difference->greatest,
                 difference->bias);
    return NACRE_OK;
}

int error_compare_scans(const struct invocation *invocation, struct nacre_error *error)
{
    struct nacre_scan *exact = NULL;
    struct nacre_scan *other = NULL;
    struct scan_difference difference;
    int status = nacre_scan_open(invocation->operands[0], &exact, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = nacre_scan_open(invocation->operands[1], &other, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = scan_difference(exact, other, &difference, error);
    if (status != NACRE_OK) {
        goto out;
    }
    status = print_difference(&difference, invocation->json, error);
out:
    nacre_scan_close(exact);
    nacre_scan_close(other);
    return status;
}
