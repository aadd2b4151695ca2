/* A ring of equal items in the caller's memory. No hardware. */
#ifndef FIRMWARE_QUEUE_H
#define FIRMWARE_QUEUE_H

#include <stdbool.h>
#include <stdint.h>

struct queue {
    uint8_t *bytes; /* capacity x size */
    uint8_t size, capacity, first, count;
};

/* False, and nothing happens, where there is no room or no item. */
bool queue_push(struct queue *queue, const void *item);
bool queue_pop(struct queue *queue, void *item);

#endif
