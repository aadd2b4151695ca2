/* What channels are called in scans and materials. Private to libnacre. */
#ifndef NACRE_CHANNEL_H
#define NACRE_CHANNEL_H

/* "R", "G", "B", or "Y" where there is one channel. */
const char *channel_name(int channels, int channel);

/* The channel that is called so, or -1. */
int channel_find(int channels, const char *name);

#endif
