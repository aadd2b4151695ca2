/* Opening the devices of a station, real or virtual. */
#include "cmd/stand.h"

int stand_open(const struct station *station, struct stand *stand, struct nacre_error *error)
{
    *stand = (struct stand){.system = clock_monotonic()};
    if (!station_is_virtual(station)) {
        return devices_open(station, &stand->system, &stand->devices, error);
    }
    int status = virtual_station_new(station, &stand->simulated, error);
    if (status == NACRE_OK) {
        stand->devices = (struct devices){.camera = virtual_station_camera(stand->simulated),
                                          .projector = virtual_station_projector(stand->simulated),
                                          .trigger = virtual_station_trigger(stand->simulated),
                                          .clock = virtual_station_clock(stand->simulated)};
    }
    return status;
}

void stand_close(struct stand *stand)
{
    devices_close(&stand->devices);
    virtual_station_free(stand->simulated);
    *stand = (struct stand){0};
}
