/* A ring of equal items. */
#include "firmware/queue.h"

#include <string.h>

bool queue_push(struct queue *queue, const void *item)
{
    if (queue->count == queue->capacity) {
        return false;
    }
    uint8_t last = (uint8_t)((queue->first + queue->count) % queue->capacity);
    memcpy(queue->bytes + (uint16_t)last * queue->size, item, queue->size);
    queue->count++;
    return true;
}

bool queue_pop(struct queue *queue, void *item)
{
    if (queue->count == 0) {
        return false;
    }
    memcpy(item, queue->bytes + (uint16_t)queue->first * queue->size, queue->size);
    queue->first = (uint8_t)((queue->first + 1) % queue->capacity);
    queue->count--;
    return true;
}
