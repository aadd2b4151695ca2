/* Linking sources with nodes, and placing nodes where their sources are. */
#include "render/sources_lattice.h"

#include "render/sources_place.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* What is known of a node's surroundings: sums over its sources, places counted from the node's own in the texture. */
struct lattice_node {
    struct group_key key;
    double weight, x, y, xx, xy, yy, position[3], by_x[3], by_y[3], normal[3], flux[3];
    bool parted;
};

static struct group_key corner_of(const struct lattice *lattice, const struct source *source,
                                  size_t k, float *share)
{
    double x = (double)source->x / lattice->size - 0.5, y = (double)source->y / lattice->size - 0.5;
    double fx = x - floor(x), fy = y - floor(y);
    *share = (float)((k % 2 ? fx : 1 - fx) * (k / 2 ? fy : 1 - fy));
    return (struct group_key){source->chart, sources_cell(x, 1) + (int32_t)(k % 2),
                              sources_cell(y, 1) + (int32_t)(k / 2), 0};
}

/* Sources between the same nodes have the same four: they are looked up once for the first of them, as long as no nodes are
 * parted. */
static int link_source(struct lattice *lattice, struct groups *cells, uint32_t *firsts, size_t i)
{
    const struct source *source = &lattice->from->list[i];
    uint32_t *links = &lattice->links[i * LATTICE_CORNERS];
    struct group_key keys[LATTICE_CORNERS];
    for (size_t k = 0; k < LATTICE_CORNERS; k++) {
        keys[k] = corner_of(lattice, source, k, &lattice->shares[i * LATTICE_CORNERS + k]);
    }
    if (!lattice->nodes) {
        size_t before = cells->count;
        uint32_t cell = groups_number(cells, keys[0]);
        if (cell == GROUPS_FULL) {
            return -1;
        }
        if (cells->count == before) {
            memcpy(links, &lattice->links[firsts[cell] * (size_t)LATTICE_CORNERS],
                   LATTICE_CORNERS * sizeof *links);
            return 0;
        }
        firsts[cell] = (uint32_t)i;
    }
    double cube = 2 * lattice->size * lattice->point_mm;
    for (size_t k = 0; k < LATTICE_CORNERS; k++) {
        if (lattice->nodes && lattice->nodes[links[k]].parted) {
            keys[k].part = groups_part(source->position, source->normal, cube);
        }
        links[k] = groups_number(&lattice->groups, keys[k]);
        if (links[k] == GROUPS_FULL) {
            return -1;
        }
    }
    return 0;
}

static int link_nodes(struct lattice *lattice)
{
    struct groups cells = {0};
    uint32_t *firsts = calloc(lattice->from->count + 1, sizeof *firsts);
    groups_end(&lattice->groups);
    int status = firsts && groups_begin(&lattice->groups, lattice->from->count / 4) == 0 &&
                         groups_begin(&cells, lattice->from->count / 4) == 0
                     ? 0
                     : -1;
    for (size_t i = 0; status == 0 && i < lattice->from->count; i++) {
        status = link_source(lattice, &cells, firsts, i);
    }
    groups_end(&cells);
    free(firsts);
    if (status == 0) {
        free(lattice->nodes);
        lattice->nodes = calloc(lattice->groups.count + 1, sizeof *lattice->nodes);
    }
    return status == 0 && lattice->nodes ? 0 : -1;
}

static void add_to_node(struct lattice_node *node, double size, float share,
                        const struct source *source)
{
    double weight = (double)share + 1e-4; /* a node at the rim needs a place, too */
    double x = (double)source->x / size - 0.5 - node->key.x;
    double y = (double)source->y / size - 0.5 - node->key.y;
    node->weight += weight;
    node->x += weight * x;
    node->y += weight * y;
    node->xx += weight * x * x;
    node->xy += weight * x * y;
    node->yy += weight * y * y;
    for (int k = 0; k < 3; k++) {
        node->position[k] += weight * (double)source->position[k];
        node->by_x[k] += weight * x * (double)source->position[k];
        node->by_y[k] += weight * y * (double)source->position[k];
        node->normal[k] += weight * (double)source->normal[k];
        node->flux[k] += (double)share * (double)source->flux[k];
    }
}

static void fill_nodes(struct lattice *lattice)
{
    for (size_t i = 0; i < lattice->from->count * LATTICE_CORNERS; i++) {
        struct lattice_node *node = &lattice->nodes[lattice->links[i]];
        const struct source *source = &lattice->from->list[i / LATTICE_CORNERS];
        float share;
        if (!(node->weight > 0)) {
            node->key = corner_of(lattice, source, i % LATTICE_CORNERS, &share);
        }
        add_to_node(node, lattice->size, lattice->shares[i], source);
    }
}

/* The node as a source, placed where the plane through its sources has it; where they lie on a line or a point, at their
 * middle. */
static struct source source_at(const struct lattice *lattice, const struct lattice_node *node)
{
    double w = node->weight, x = node->x / w, y = node->y / w, length = 0;
    double xx = node->xx / w - x * x, xy = node->xy / w - x * y, yy = node->yy / w - y * y;
    double determinant = xx * yy - xy * xy;
    bool flat = determinant > 1e-4;
    struct source source = {.x = (float)((node->key.x + 0.5) * lattice->size),
                            .y = (float)((node->key.y + 0.5) * lattice->size),
                            .chart = node->key.kind};
    for (int k = 0; k < 3; k++) {
        double p = node->position[k] / w, n = node->normal[k] / w;
        double px = node->by_x[k] / w - x * p, py = node->by_y[k] / w - y * p;
        double along_x = flat ? (yy * px - xy * py) / determinant : 0;
        double along_y = flat ? (xx * py - xy * px) / determinant : 0;
        source.position[k] = (float)(p - x * along_x - y * along_y);
        source.normal[k] = (float)n;
        source.flux[k] = (float)node->flux[k];
        length += n * n;
    }
    for (int k = 0; k < 3; k++) {
        source.normal[k] /= (float)(length > 0 ? sqrt(length) : 1);
    }
    return source;
}

static void place_nodes(const struct lattice *lattice, struct source_set *to)
{
    to->count = lattice->groups.count;
    for (size_t i = 0; i < to->count; i++) {
        to->list[i] = source_at(lattice, &lattice->nodes[i]);
    }
}

/* Mark nodes whose sources are too far from them or turned too differently. */
static bool must_part_nodes(struct lattice *lattice, const struct source_set *nodes)
{
    double most = 2 * SOURCES_WIDEST * lattice->size * lattice->point_mm;
    bool any = false;
    for (size_t i = 0; i < nodes->count; i++) {
        double length = 0;
        for (int k = 0; k < 3; k++) {
            double n = lattice->nodes[i].normal[k] / lattice->nodes[i].weight;
            length += n * n;
        }
        lattice->nodes[i].parted = length < SOURCES_STRAIGHTEST * SOURCES_STRAIGHTEST;
    }
    for (size_t i = 0; i < lattice->from->count * LATTICE_CORNERS; i++) {
        const float *p = lattice->from->list[i / LATTICE_CORNERS].position;
        const float *q = nodes->list[lattice->links[i]].position;
        double x = (double)p[0] - q[0], y = (double)p[1] - q[1], z = (double)p[2] - q[2];
        struct lattice_node *node = &lattice->nodes[lattice->links[i]];
        node->parted = node->parted || x * x + y * y + z * z > most * most;
        any = any || node->parted;
    }
    return any;
}

int lattice_make(struct lattice *lattice, struct source_set *to)
{
    size_t links = lattice->from->count * LATTICE_CORNERS;
    lattice->links = calloc(links + 1, sizeof *lattice->links);
    lattice->shares = calloc(links + 1, sizeof *lattice->shares);
    for (int pass = 0; pass < 2; pass++) {
        if (!lattice->links || !lattice->shares || link_nodes(lattice) != 0) {
            return -1;
        }
        fill_nodes(lattice);
        free(to->list);
        to->list = calloc(lattice->groups.count + 1, sizeof *to->list);
        if (!to->list) {
            return -1;
        }
        place_nodes(lattice, to);
        if (pass > 0 || !must_part_nodes(lattice, to)) {
            break;
        }
    }
    return 0;
}

void lattice_finish(struct lattice *lattice)
{
    groups_end(&lattice->groups);
    free(lattice->links);
    free(lattice->shares);
    free(lattice->nodes);
}
