/* Loading libOSMesa and its functions. */
#include "render/osmesa.h"

#include <GL/osmesa.h>

#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>

enum { SURFACE = 16 }; /* pixels on a side; pictures are drawn elsewhere */

typedef OSMesaContext create_context(const int *attributes, OSMesaContext share);
typedef void destroy_context(OSMesaContext context);
typedef GLboolean make_current(OSMesaContext context, void *buffer, GLenum type, GLsizei width,
                               GLsizei height);
typedef OSMESAproc get_address(const char *name);

/* dlsym, into a pointer to a function at `slot`. */
static int load(void *library, const char *name, void *slot, struct nacre_error *error)
{
    void *symbol = dlsym(library, name);
    if (!symbol) {
        return nacre_fail(error, "libOSMesa has no %s; install libosmesa6 22 or newer", name);
    }
    memcpy(slot, &symbol, sizeof symbol);
    return NACRE_OK;
}

static int load_functions(struct osmesa *gl, get_address *address, struct nacre_error *error)
{
    const char *missing = NULL;
#define OSMESA_LOAD(upper, function)                                                               \
    {                                                                                              \
        OSMESAproc found = address("gl" #function);                                                \
        memcpy(&gl->function, &found, sizeof found);                                               \
        missing = found ? missing : "gl" #function;                                                \
    }
    OSMESA_FUNCTIONS(OSMESA_LOAD)
#undef OSMESA_LOAD
    return missing
               ? nacre_fail(error, "libOSMesa has no %s; install libosmesa6 22 or newer", missing)
               : NACRE_OK;
}

int osmesa_open(struct osmesa *gl, struct nacre_error *error)
{
    const int attributes[] = {OSMESA_FORMAT,
                              OSMESA_RGBA,
                              OSMESA_PROFILE,
                              OSMESA_CORE_PROFILE,
                              OSMESA_CONTEXT_MAJOR_VERSION,
                              4,
                              OSMESA_CONTEXT_MINOR_VERSION,
                              0,
                              0};
    create_context *create = NULL;
    make_current *current = NULL;
    get_address *address = NULL;
    *gl = (struct osmesa){0};
    /* It never goes: its drivers keep threads and memory until the program ends. */
    void *library = dlopen("libOSMesa.so.8", RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE);
    if (!library) {
        return nacre_fail(error, "cannot draw a preview: %s (Debian: apt install libosmesa6)",
                          dlerror());
    }
    if (load(library, "OSMesaCreateContextAttribs", &create, error) != NACRE_OK ||
        load(library, "OSMesaMakeCurrent", &current, error) != NACRE_OK ||
        load(library, "OSMesaGetProcAddress", &address, error) != NACRE_OK || !create || !current ||
        !address) {
        return NACRE_FAILED;
    }
    gl->context = create(attributes, NULL);
    gl->surface = calloc((size_t)SURFACE * SURFACE, 4);
    if (!gl->context || !gl->surface ||
        !current(gl->context, gl->surface, GL_UNSIGNED_BYTE, SURFACE, SURFACE)) {
        return nacre_fail(error, "cannot draw a preview: libOSMesa gives no OpenGL 4.0 context");
    }
    return load_functions(gl, address, error);
}

void osmesa_close(struct osmesa *gl)
{
    void *library = gl->context ? dlopen("libOSMesa.so.8", RTLD_NOW | RTLD_LOCAL) : NULL;
    destroy_context *destroy = NULL;
    struct nacre_error unused;
    if (library && load(library, "OSMesaDestroyContext", &destroy, &unused) == NACRE_OK &&
        destroy) {
        destroy(gl->context);
    }
    free(gl->surface);
    *gl = (struct osmesa){0};
}
