/* The graphics cards of this machine. */
#ifndef RIG_DISPLAY_LIST_H
#define RIG_DISPLAY_LIST_H

#include "rig/display_choice.h"

/* Read the connectors of the card that `file` has open as `path`; display_card_finish frees. Returns 0 or errno. */
int display_card_read(int file, const char *path, struct display_card *card);
void display_card_finish(struct display_card *card); /* NULL and zeroed are allowed */

/* All cards that set modes, by their nodes' order. `refused` gets the path of one that may not be opened, or "". The
 * caller frees by display_cards_free. */
int display_cards_list(struct display_card **cards, size_t *count, char *refused, size_t size,
                       struct nacre_error *error);
void display_cards_free(struct display_card *cards, size_t count);

/* Fail for a node that may not be opened. */
int display_fail_open(const char *path, struct nacre_error *error);

#endif
