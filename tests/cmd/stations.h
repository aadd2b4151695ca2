/* Settings files of a small virtual station, and a small scene. */
#ifndef TESTS_CMD_STATIONS_H
#define TESTS_CMD_STATIONS_H

enum { STATION_WIDTH = 20, STATION_HEIGHT = 16, STATION_WINDOW = 11, STATION_GRIDS = 121 };
#define STATION_WINDOW_TEXT "11"

/* Write FOLDER/station.yaml, plan.yaml and sample.yaml: 20 x 16 points of two materials, an 11 x 11 window. */
void stations_write(const char *folder);

/* The same with a lamp that drifts and flickers, a read-out time and frames that are dropped or late. */
void stations_write_restless(const char *folder);

/* Replace `from`, which must be there, by `to` in a settings file. */
void stations_change(const char *path, const char *from, const char *to);

/* Write a scene of a slab in that material. */
void stations_write_scene(const char *path, const char *material);

#endif
