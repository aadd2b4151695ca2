/* The camera's place and axes, and where points appear in its picture. */
#ifndef RENDER_VIEW_H
#define RENDER_VIEW_H

#include "render/scene.h"
#include "render/vector.h"

#include <stdbool.h>

struct view {
    struct vec3 position, right, up, forward; /* orthonormal; right is right in the picture */
    double tan_x, tan_y;                      /* half extents of the picture at unit distance */
};

/* As the scene says, and then turned by degrees about the vertical through what the camera looks at. */
static inline struct view view_make(const struct scene *scene, double turn_deg)
{
    const struct scene_camera *camera = &scene->camera;
    const double degrees[3] = {0, 0, turn_deg};
    struct motion turn = motion_make(degrees, vec3_from_doubles(camera->at_mm));
    struct vec3 away =
        vec3_subtract(vec3_from_doubles(camera->position_mm), vec3_from_doubles(camera->at_mm));
    double half = tan(camera->angle_deg / 2 * acos(-1.0) / 180);
    struct view view = {
        .position = motion_move(&turn, away),
        .tan_x = half,
        .tan_y = half * scene->image.height / scene->image.width,
    };
    view.forward = vec3_unit(motion_turn(&turn, vec3_scale(away, -1)));
    view.right =
        vec3_unit(vec3_cross(view.forward, motion_turn(&turn, vec3_from_doubles(camera->up))));
    view.up = vec3_cross(view.right, view.forward);
    return view;
}

/* Where a point in front of the camera appears: 0 to 1 from left to right and from the top down. */
static inline void view_project(const struct view *view, struct vec3 point, double at[2])
{
    struct vec3 way = vec3_subtract(point, view->position);
    double depth = vec3_dot(way, view->forward);
    at[0] = (1 + vec3_dot(way, view->right) / depth / view->tan_x) / 2;
    at[1] = (1 - vec3_dot(way, view->up) / depth / view->tan_y) / 2;
}

/* Whether a sphere reaches beyond none of the sides of the pyramid that the camera sees, nor behind its tip. */
static inline bool view_meets(const struct view *view, struct vec3 middle, double radius)
{
    struct vec3 way = vec3_subtract(middle, view->position);
    double depth = vec3_dot(way, view->forward);
    return depth > -radius &&
           fabs(vec3_dot(way, view->right)) - depth * view->tan_x <
               radius * hypot(1, view->tan_x) &&
           fabs(vec3_dot(way, view->up)) - depth * view->tan_y < radius * hypot(1, view->tan_y);
}

#endif
