/* The files of a folder for POV-Ray: those that nacre writes, and those that povray leaves beside them. */
#include "render/pov_folder.h"

#include "render/effects.h"
#include "render/pov.h"
#include "render/pov_digest.h"
#include "render/pov_sky.h"

#include <stdbool.h>
#include <stdio.h>
#include <unistd.h>

enum { PATH_SIZE = 4096 };

typedef void file_taker(void *context, const char *path);

static void take(const char *folder, const char *name, file_taker *taker, void *context)
{
    char path[PATH_SIZE];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    taker(context, path);
}

/* What pov_write makes of the scene. */
static void each_written(const char *folder, const struct scene *scene, file_taker *taker,
                         void *context)
{
    char name[64];
    take(folder, POV_MAIN, taker, context);
    for (size_t i = 0; i < scene->object_count; i++) {
        (void)snprintf(name, sizeof name, POV_OBJECT, i);
        take(folder, name, taker, context);
    }
    for (size_t i = 0; i < scene->light_count; i++) {
        if (scene->lights[i].kind == LIGHT_PROJECTOR && !render_forbids(scene, RENDER_PROJECTED)) {
            (void)snprintf(name, sizeof name, POV_SLIDE, i);
            take(folder, name, taker, context);
        }
    }
    if (scene->environment.image && !render_forbids(scene, RENDER_ENVIRONMENT)) {
        take(folder, POV_SKY, taker, context);
    }
}

/* What povray leaves. */
static void each_left(const char *folder, file_taker *taker, void *context)
{
    take(folder, "povray.log", taker, context);
    take(folder, "picture.exr", taker, context);
}

/* Files that must stay as they are. */
struct foreign {
    char first[PATH_SIZE];
    size_t count;
};

static void add_foreign(struct foreign *foreign, const char *path)
{
    if (foreign->count++ == 0) {
        (void)snprintf(foreign->first, sizeof foreign->first, "%s", path);
    }
}

static bool is_there(const char *path)
{
    return access(path, F_OK) == 0;
}

static void add_if_changed(void *context, const char *path)
{
    if (is_there(path) && !pov_is_as_written(path)) {
        add_foreign(context, path);
    }
}

static void add_if_there(void *context, const char *path)
{
    if (is_there(path)) {
        add_foreign(context, path);
    }
}

static void note_if_there(void *context, const char *path)
{
    *(bool *)context = is_there(path);
}

int pov_folder_check(const char *folder, const struct scene *scene, struct nacre_error *error)
{
    struct foreign foreign = {.count = 0};
    char others[64] = "";
    bool scene_there = false;
    each_written(folder, scene, add_if_changed, &foreign);
    /* povray's carry no digest: where there is no scene for them, they are of something else. */
    take(folder, POV_MAIN, note_if_there, &scene_there);
    if (!scene_there) {
        each_left(folder, add_if_there, &foreign);
    }
    if (foreign.count > 1) {
        (void)snprintf(others, sizeof others, " (and %zu more)", foreign.count - 1);
    }
    return foreign.count == 0
               ? NACRE_OK
               : nacre_fail(error,
                            "%s%s would be overwritten, and is not as nacre wrote it; name another "
                            "folder, or rename or remove it",
                            foreign.first, others);
}

static void remove_file(void *context, const char *path)
{
    (void)context;
    (void)unlink(path);
}

void pov_folder_remove(const char *folder, const struct scene *scene)
{
    each_written(folder, scene, remove_file, NULL);
    each_left(folder, remove_file, NULL);
    (void)rmdir(folder);
}
