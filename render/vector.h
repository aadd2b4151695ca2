/* Points and directions in space (right-handed, z up, mm), and the rigid motion that places an object. */
#ifndef RENDER_VECTOR_H
#define RENDER_VECTOR_H

#include <math.h>

struct vec3 {
    double x, y, z;
};

static inline struct vec3 vec3_from(const float v[3])
{
    return (struct vec3){v[0], v[1], v[2]};
}

static inline struct vec3 vec3_from_doubles(const double v[3])
{
    return (struct vec3){v[0], v[1], v[2]};
}

static inline void vec3_store(struct vec3 v, float out[3])
{
    out[0] = (float)v.x;
    out[1] = (float)v.y;
    out[2] = (float)v.z;
}

static inline struct vec3 vec3_add(struct vec3 a, struct vec3 b)
{
    return (struct vec3){a.x + b.x, a.y + b.y, a.z + b.z};
}

static inline struct vec3 vec3_subtract(struct vec3 a, struct vec3 b)
{
    return (struct vec3){a.x - b.x, a.y - b.y, a.z - b.z};
}

static inline struct vec3 vec3_scale(struct vec3 a, double factor)
{
    return (struct vec3){a.x * factor, a.y * factor, a.z * factor};
}

/* a + factor * b */
static inline struct vec3 vec3_along(struct vec3 a, double factor, struct vec3 b)
{
    return vec3_add(a, vec3_scale(b, factor));
}

static inline double vec3_dot(struct vec3 a, struct vec3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline struct vec3 vec3_cross(struct vec3 a, struct vec3 b)
{
    return (struct vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

static inline double vec3_length(struct vec3 a)
{
    return sqrt(vec3_dot(a, a));
}

/* A zero vector stays zero. */
static inline struct vec3 vec3_unit(struct vec3 a)
{
    double length = vec3_length(a);
    return length > 0 ? vec3_scale(a, 1 / length) : a;
}

/* A unit vector at right angles to the unit vector a. */
static inline struct vec3 vec3_perpendicular(struct vec3 a)
{
    struct vec3 other = fabs(a.z) < 0.9 ? (struct vec3){0, 0, 1} : (struct vec3){1, 0, 0};
    return vec3_unit(vec3_cross(other, a));
}

/* A unit vector on the side of the unit normal, by u[2] in [0, 1)^2, drawn by its cosine to the normal (over pi). */
static inline struct vec3 vec3_by_cosine(struct vec3 normal, const double u[2])
{
    struct vec3 side = vec3_perpendicular(normal), other = vec3_cross(normal, side);
    double r = sqrt(u[0]), angle = 2 * acos(-1.0) * u[1];
    return vec3_along(vec3_along(vec3_scale(normal, sqrt(fmax(1 - u[0], 0))), r * cos(angle), side),
                      r * sin(angle), other);
}

/* Rotation, then translation: from an object's own frame into the scene. */
struct motion {
    struct vec3 axes[3]; /* where the object's x, y and z point; orthonormal */
    struct vec3 origin;
};

/* Turned by degrees about x, then y, then z, then moved to `origin`. */
static inline struct motion motion_make(const double degrees[3], struct vec3 origin)
{
    double r = acos(-1.0) / 180;
    double cx = cos(degrees[0] * r), sx = sin(degrees[0] * r);
    double cy = cos(degrees[1] * r), sy = sin(degrees[1] * r);
    double cz = cos(degrees[2] * r), sz = sin(degrees[2] * r);
    return (struct motion){.axes = {{cy * cz, cy * sz, -sy},
                                    {sx * sy * cz - cx * sz, sx * sy * sz + cx * cz, sx * cy},
                                    {cx * sy * cz + sx * sz, cx * sy * sz - sx * cz, cx * cy}},
                           .origin = origin};
}

static inline struct vec3 motion_turn(const struct motion *motion, struct vec3 v)
{
    return vec3_along(vec3_along(vec3_scale(motion->axes[0], v.x), v.y, motion->axes[1]), v.z,
                      motion->axes[2]);
}

static inline struct vec3 motion_turn_back(const struct motion *motion, struct vec3 v)
{
    return (struct vec3){vec3_dot(motion->axes[0], v), vec3_dot(motion->axes[1], v),
                         vec3_dot(motion->axes[2], v)};
}

static inline struct vec3 motion_move(const struct motion *motion, struct vec3 p)
{
    return vec3_add(motion->origin, motion_turn(motion, p));
}

static inline struct vec3 motion_move_back(const struct motion *motion, struct vec3 p)
{
    return motion_turn_back(motion, vec3_subtract(p, motion->origin));
}

#endif
