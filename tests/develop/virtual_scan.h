/* A virtual station's scan from its files to developed responses, in a folder. */
#ifndef TESTS_DEVELOP_VIRTUAL_SCAN_H
#define TESTS_DEVELOP_VIRTUAL_SCAN_H

#include "rig/develop/develop.h"
#include "rig/sequence.h"

/* Write a text file FOLDER/NAME. */
void virtual_scan_write(const char *folder, const char *name, const char *text);

/* Measure FOLDER/station.yaml into FOLDER/session, with 20 retries. */
void virtual_scan_measure(const char *folder, struct sequence_result *result);

/* The same, developed as FOLDER/scan.exr. */
void virtual_scan_run(const char *folder, struct sequence_result *result,
                      struct develop_report *report);

/* The same with the devices that `wrap` puts in place of the virtual station's. */
void virtual_scan_run_around(const char *folder, void (*wrap)(void *context, struct devices *),
                             void *context, struct sequence_result *result,
                             struct develop_report *report);

/* The exact responses of FOLDER/sample.yaml as FOLDER/exact.exr. */
void virtual_scan_exact(const char *folder, int window);

/* All responses of FOLDER/NAME: [height][width][channels][K][K]; heap. */
float *virtual_scan_load(const char *folder, const char *name);

/* Whether what made FOLDER/scan.exr is recorded in it with these words. */
bool virtual_scan_source_names(const char *folder, const char *words);

#endif
