/* Grey light on a grey material: three terms take the places of the three colours, which would all be the same, so that
 * the gather has a third of the work. */
#ifndef RENDER_GREY_H
#define RENDER_GREY_H

#include "nacre/error.h"
#include "render/appearance.h"

/* Lay the material's terms out anew, where that makes fewer of them; what is gathered is then the sum of the three
 * colours. The material must be grey. */
int grey_pack(struct appearance *appearance, struct nacre_error *error);

/* Add what was gathered to all colours of radiosity[count][3]. */
void grey_unpack(float (*gathered)[3], size_t count, float (*radiosity)[3]);

#endif
