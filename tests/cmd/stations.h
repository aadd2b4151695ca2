/* Settings files of a small virtual station, and a small scene. */
#ifndef TESTS_CMD_STATIONS_H
#define TESTS_CMD_STATIONS_H

enum { STATION_WIDTH = 16, STATION_HEIGHT = 12, STATION_GRIDS = 36 };

/* Write FOLDER/station.yaml, plan.yaml and sample.yaml: 16 x 12 points of two materials, a 5 x 5 window. */
void stations_write(const char *folder);

/* Write a scene of a slab in that material. */
void stations_write_scene(const char *path, const char *material);

#endif
