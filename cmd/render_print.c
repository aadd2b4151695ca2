/* What nacre render tells of its work. */
#include "cmd/render_print.h"

#include "cmd/json_print.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>

static uint64_t rays_of(const struct light_work *work)
{
    return work->shadow_rays + work->bounce_rays + work->photons;
}

static void print_object(size_t number, const struct render_object_report *object)
{
    const struct bake_counts *counts = &object->counts;
    (void)printf("object %zu      %zu vertices, %zu triangles", number + 1, object->vertices,
                 object->triangles);
    if (object->degenerate > 0) {
        (void)printf(" (%zu without area left out)", object->degenerate);
    }
    (void)printf("\n");
    if (object->open_edges > 0 || object->crowded_edges > 0) {
        (void)printf("  edges       %zu have one triangle (the mesh is open), %zu more than two\n",
                     object->open_edges, object->crowded_edges);
    }
    if (!object->translucent) {
        if (object->limited) {
            (void)printf("  coarse      edges are longer than light on it needs; raise "
                         "--triangles\n");
        }
        return;
    }
    (void)printf("  light       %zu samples, %llu rays", counts->samples,
                 (unsigned long long)rays_of(&counts->work));
    if (counts->gather.convolved > 0) {
        (void)printf("; %.3g %% of the vertices by convolution",
                     100 * (double)counts->gather.convolved / (double)counts->gather.receivers);
    }
    (void)printf("\n");
    (void)printf(
        "  surface point %.3g mm, drawn larger by %.2f / %.2f / %.2f (5 / 50 / 95 %% of the "
        "surface)\n",
        object->point_mm, object->stretch[0], object->stretch[1], object->stretch[2]);
    if (object->edge_on > 0) {
        (void)printf("  streaks     %.2g %% of the surface, which the mapping sees from the side\n",
                     100 * object->edge_on);
    }
    if (object->limited) {
        (void)printf("  coarse      edges are longer than a surface point; raise --triangles\n");
    }
}

/* Frames a second of drawing alone; 0: POV-Ray drew. */
static double frame_rate(int frames, const struct render_report *report)
{
    return frames ? frames / fmax(report->frame_seconds, 1e-9) : 0;
}

/* Of many steps. */
enum { FIRST_SHOWN = 8, LAST_SHOWN = 4 };

/* What was tried and what it brought. */
static void print_refine(const struct refine_report *refine)
{
    for (int i = 0; i < refine->count; i++) {
        const struct refine_try *try = &refine->steps[i];
        if (i >= FIRST_SHOWN && i < refine->count - LAST_SHOWN) {
            continue;
        }
        (void)printf("step %-2d       %.4g samples to a surface point, tolerance %.3g %%, %.1f s, "
                     "noise %.3g %%\n",
                     i + 1, try->density, 100 * try->tolerance, try->seconds, 100 * try->noise);
    }
    if (refine->count > 0) {
        (void)printf(
            "error         about %.3g %% (noise %.3g %%, summing up %.3g %%), ended by %s\n",
            100 * refine->error, 100 * refine->noise, 100 * refine->bias, refine->stopped_by);
    }
}

void render_print_text(const char *picture, int frames, const struct render_report *report)
{
    for (size_t i = 0; i < report->object_count; i++) {
        print_object(i, &report->objects[i]);
    }
    print_refine(&report->refine);
    (void)printf("time          mesh %.1f s, light %.1f s, gather %.1f s", report->mesh_seconds,
                 report->light_seconds, report->gather_seconds);
    if (frames > 0) {
        (void)printf(", preview %.1f s, then %.1f frames a second\n", report->preview_seconds,
                     frame_rate(frames, report));
    } else {
        (void)printf(", export %.1f s, povray %.1f s\n", report->export_seconds,
                     report->povray_seconds);
    }
    (void)printf("picture       %s\n", picture);
}

static json_t *refine_to_json(const struct refine_report *refine)
{
    json_t *steps = json_array();
    for (int i = 0; i < refine->count; i++) {
        const struct refine_try *try = &refine->steps[i];
        (void)json_array_append_new(steps, json_pack("{s:f, s:f, s:f, s:f}", "samples_per_point",
                                                     try->density, "tolerance", try->tolerance,
                                                     "noise", try->noise, "seconds", try->seconds));
    }
    return json_pack("{s:f, s:f, s:f, s:b, s:s, s:o}", "error", refine->error, "noise",
                     refine->noise, "summing_up", refine->bias, "error_held", refine->error_held,
                     "stopped_by", refine->stopped_by, "steps", steps);
}

int render_print_json(const char *picture, int frames, const struct render_report *report,
                      struct nacre_error *error)
{
    json_t *objects = json_array();
    json_t *root =
        json_pack("{s:s, s:{s:f, s:f, s:f, s:f, s:f, s:f}, s:f, s:o}", "picture", picture,
                  "seconds", "mesh", report->mesh_seconds, "light", report->light_seconds, "gather",
                  report->gather_seconds, "export", report->export_seconds, "povray",
                  report->povray_seconds, "preview", report->preview_seconds, "frames_per_second",
                  frame_rate(frames, report), "objects", objects);
    for (size_t i = 0; root && i < report->object_count; i++) {
        const struct render_object_report *o = &report->objects[i];
        (void)json_array_append_new(
            objects,
            json_pack(
                "{s:I, s:I, s:I, s:I, s:I, s:b, s:I, s:I, s:I, s:I, s:f, s:[f, f, f], s:f, s:b}",
                "vertices", (json_int_t)o->vertices, "triangles", (json_int_t)o->triangles,
                "degenerate", (json_int_t)o->degenerate, "open_edges", (json_int_t)o->open_edges,
                "crowded_edges", (json_int_t)o->crowded_edges, "translucent", o->translucent,
                "samples", (json_int_t)o->counts.samples, "pairs",
                (json_int_t)o->counts.gather.points + (json_int_t)o->counts.gather.squares,
                "convolved", (json_int_t)o->counts.gather.convolved, "rays",
                (json_int_t)rays_of(&o->counts.work), "point_mm", o->point_mm, "stretch",
                o->stretch[0], o->stretch[1], o->stretch[2], "edge_on", o->edge_on, "limited",
                o->limited));
    }
    if (root && report->refine.count > 0) {
        (void)json_object_set_new(root, "refined", refine_to_json(&report->refine));
    }
    return json_print(root, error);
}
