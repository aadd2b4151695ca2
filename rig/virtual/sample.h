/* sample.yaml: a slab of translucent material, what it is made of and what lies in it. */
#ifndef RIG_VIRTUAL_SAMPLE_H
#define RIG_VIRTUAL_SAMPLE_H

#include "base/picture.h"
#include "base/settings.h"
#include "nacre/error.h"

#include <stdbool.h>
#include <stddef.h>

/* A homogeneous medium. Scattering and absorption are what counts once a file is read: where the file gives albedo and
 * mean free path, sample_read computes them from these. */
struct sample_material {
    char *name;
    double scattering_per_mm[3], absorption_per_mm[3]; /* R G B */
    double albedo[3], mean_free_path_mm[3];
    double anisotropy[3]; /* mean cosine of the scattering angle */
    double index;         /* of refraction */
    int line, scattering_line, absorption_line, albedo_line, mean_free_path_line, anisotropy_line,
        index_line;
};

/* A line of some width: through points, or straight at an angle through one. */
struct sample_vein {
    double *points_mm; /* x0 y0 x1 y1 ...; heap */
    size_t point_count;
    double width_mm;
    int points_line, line;
};

/* Parallel stripes. */
struct sample_bands {
    double angle_deg; /* of the stripes: 0 runs along x */
    double period_mm;
    double fraction; /* of a period that is painted */
    double start_mm; /* where the first painted stripe begins */
    int line;
};

/* A chessboard; the square that begins at the origin is painted. */
struct sample_checker {
    double square_mm;
    double origin_mm[2];
    int line;
};

/* Voronoi cells around scattered points; a share of them is painted, or the seams between all of them. */
struct sample_cells {
    double size_mm;  /* mean distance between neighbouring cells */
    double fraction; /* of the cells that are painted */
    double seam_mm;  /* above 0: paint seams of this width instead */
    int line;
};

/* Smooth noise; painted where it is high. */
struct sample_clouds {
    double size_mm;  /* of the largest clouds */
    double fraction; /* of the volume that is painted, roughly */
    int octaves;
    int line;
};

/* A picture as a map, seen from above; painted where it is bright. */
struct sample_map {
    char *image;
    double origin_mm[2]; /* of the picture's upper left corner */
    double size_mm[2];
    double above; /* the mean of R, G and B, linear, that a painted place exceeds */
    int line, image_line;
    struct picture picture; /* set by sample_read */
};

/* A region painted with a material; without a shape it is a layer. */
struct sample_inclusion {
    char *material;
    double depth_mm[2];    /* from, to */
    double wander_mm;      /* how far its outline strays */
    double wander_size_mm; /* over what length */
    double lean[2];        /* shift in x and y for each mm of depth */
    int seed;
    struct sample_vein vein;
    struct sample_bands bands;
    struct sample_checker checker;
    struct sample_cells cells;
    struct sample_clouds clouds;
    struct sample_map map;
    int line, material_line, depth_line, wander_line, lean_line;
    size_t material_index; /* set by sample_read */
};

/* The solver's resolution, where the file sets it. */
struct sample_voxels {
    int subdivide;   /* voxels along a surface point; 0: chosen from the mean free paths */
    int depth_cells; /* voxels along the depth; 0: chosen likewise */
};

/* The sample's upper side. */
struct sample_surface {
    double
        roughness; /* root mean square slope of its facets; 0: polished, mirrors past the camera */
    int line;
};

/* Opaque specks that lie on it. */
struct sample_dust {
    double per_cm2;
    double size_mm; /* mean diameter */
    int seed;
    int line;
};

struct sample {
    int width, height;   /* surface points */
    double pitch_mm;     /* between surface points */
    double thickness_mm; /* of the slab; light that leaves through its bottom is lost */
    int margin_points;   /* by which the slab goes on beyond the sample on every side */
    char *base;          /* the material that fills the slab */
    struct sample_voxels voxels;
    struct sample_material *materials;
    size_t material_count;
    struct sample_inclusion *inclusions; /* painted in this order */
    size_t inclusion_count;
    struct sample_surface surface;
    struct sample_dust dust;
    char **without; /* names of effects that are not to be simulated; heap */
    size_t without_count;
    size_t
        forbidden_inclusions; /* read, and not counted in inclusion_count as `without` wants none */
    int without_line;
    int thickness_line, margin_line, base_line, voxels_line;
    size_t base_index; /* set by sample_read */
    /* Where the corner of the first surface point lies, from the place that the file counts from; 0 as it is read. A
     * projector that is out of its place has its points elsewhere. */
    double corner_mm[2];
};

extern const struct settings_schema sample_schema;

/* Read and check a sample file; sample_finish frees. */
int sample_read(const char *path, struct sample *sample, struct nacre_error *error);
void sample_finish(struct sample *sample);

/* Effects within the sample that its file may forbid, as it calls them. */
#define SAMPLE_ABSORPTION    "absorption"
#define SAMPLE_DIRECTED      "directed scattering"
#define SAMPLE_INSIDE        "reflection inside the surface"
#define SAMPLE_HETEROGENEITY "heterogeneity"

/* Whether the file forbids the effect of that name. */
bool sample_forbids(const struct sample *sample, const char *effect);

/* "; without A, B" of what the file forbids, for the record; "" where it forbids nothing. Cut to `size`. */
void sample_without_text(const struct sample *sample, char *text, size_t size);

/* What the inclusion is, in the words of the file: "vein", "layer", ... */
const char *sample_shape_name(const struct sample_inclusion *inclusion);

/* The shortest reduced mean free path 1 / (absorption + (1 - g) scattering) of any material and channel, in mm. */
double sample_shortest_path_mm(const struct sample *sample);

/* The inclusion that paints a place: x and y from the sample's corner, z from its surface down, in mm. inclusion_count
 * where none does. */
size_t sample_inclusion_at(const struct sample *sample, const double place_mm[3]);

/* The index of the material there. */
size_t sample_material_at(const struct sample *sample, const double place_mm[3]);

#endif
