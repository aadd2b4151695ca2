/* Names of colour channels. */
#include "channel.h"

#include <string.h>

const char *channel_name(int channels, int channel)
{
    static const char *const names[] = {"R", "G", "B"};
    return channels == 1 ? "Y" : names[channel];
}

int channel_find(int channels, const char *name)
{
    int count = channels == 1 ? 1 : 3;
    for (int c = 0; c < count; c++) {
        if (strcmp(name, channel_name(channels, c)) == 0) {
            return c;
        }
    }
    return -1;
}
