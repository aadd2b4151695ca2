/* Printing how good and how large a material is. */
#include "cmd/error_print.h"

#include "factor/words.h"

#include <stdio.h>
#include <sys/stat.h>

static double file_size(const char *path)
{
    struct stat status;
    return stat(path, &status) == 0 ? (double)status.st_size : 0;
}

static void print_range(const char *label, const struct error_range *range)
{
    if (range->points == 0) {
        printf("%-26s none: no point has one\n", label);
    } else {
        printf("%-26s %.4f / %.4f / %.4f   (energy ratio: mean %.3g)\n", label, range->minimum,
               range->mean, range->maximum, range->energy_mean);
    }
}

void error_print(const struct error_report *report, const struct nacre_material *m,
                 const char *path)
{
    double before = error_measured_bytes(m), after = (double)nacre_material_size(m);
    print_range("relative error", &report->whole);
    print_range("  without the centre", &report->without_centre);
    printf("%-26s %zu of %zu; %zu not measured, %zu measured as 0\n", "surface points",
           report->whole.points, report->points, report->not_measured, report->dark);
    printf("%-26s %.3f MiB as responses, %.3f MiB factored: ratio %s\n", "size", before * 0x1p-20,
           after * 0x1p-20, ratio_words(before, after).text);
    printf("%-26s %.3f MiB\n", "  file", file_size(path) * 0x1p-20);
}

static json_t *range_to_json(const struct error_range *range)
{
    if (range->points == 0) {
        return json_null();
    }
    return json_pack("{s:f, s:f, s:f, s:f, s:I}", "min", range->minimum, "mean", range->mean, "max",
                     range->maximum, "energy_mean", range->energy_mean, "points",
                     (json_int_t)range->points);
}

json_t *error_to_json(const struct error_report *report, const struct nacre_material *m,
                      const char *path)
{
    double before = error_measured_bytes(m), after = (double)nacre_material_size(m);
    return json_pack("{s:o, s:o, s:I, s:I, s:I, s:f, s:f, s:f, s:f}", "error",
                     range_to_json(&report->whole), "error_without_centre",
                     range_to_json(&report->without_centre), "points", (json_int_t)report->points,
                     "points_not_measured", (json_int_t)report->not_measured, "points_dark",
                     (json_int_t)report->dark, "bytes_measured", before, "bytes_factored", after,
                     "bytes_file", file_size(path), "ratio", before / after);
}
