/* The shaders of previews. */
#include "render/preview_parts.h"

#include <stdlib.h>

int preview_check(const struct preview *preview, const char *action, struct nacre_error *error)
{
    GLenum code = preview->gl.GetError();
    return code == GL_NO_ERROR ? NACRE_OK
           : code == GL_OUT_OF_MEMORY
               ? nacre_fail_memory(error, "a preview")
               : nacre_fail(error, "cannot draw a preview: OpenGL says 0x%x when %s", code, action);
}

/* The source behind `begin` in place of the line that tells its name, which OpenGL does not know. */
static int compile(const struct osmesa *gl, GLenum kind, const char *begin,
                   const struct opencl_source *source, GLuint *shader, struct nacre_error *error)
{
    char message[512] = "";
    GLint good = GL_FALSE;
    const char **lines = calloc(source->line_count, sizeof *lines);
    if (!lines) {
        return nacre_fail_memory(error, "a shader");
    }
    for (size_t i = 0; i < source->line_count; i++) {
        lines[i] = i ? source->lines[i] : begin;
    }
    *shader = gl->CreateShader(kind);
    gl->ShaderSource(*shader, (GLsizei)source->line_count, lines, NULL);
    free(lines);
    gl->CompileShader(*shader);
    gl->GetShaderiv(*shader, GL_COMPILE_STATUS, &good);
    gl->GetShaderInfoLog(*shader, sizeof message, NULL, message);
    return good ? NACRE_OK
                : nacre_fail(error, "cannot draw a preview: %s: %s", source->name, message);
}

int preview_link(const struct osmesa *gl, const struct opencl_source *vertices, const char *begin,
                 const struct opencl_source *pixels, GLuint *program, struct nacre_error *error)
{
    char message[512] = "";
    GLint good = GL_FALSE;
    GLuint shaders[2] = {0, 0};
    int status = compile(gl, GL_VERTEX_SHADER, PREVIEW_VERSION, vertices, &shaders[0], error);
    if (status == NACRE_OK) {
        status = compile(gl, GL_FRAGMENT_SHADER, begin, pixels, &shaders[1], error);
    }
    if (status == NACRE_OK) {
        *program = gl->CreateProgram();
        gl->AttachShader(*program, shaders[0]);
        gl->AttachShader(*program, shaders[1]);
        gl->LinkProgram(*program);
        gl->GetProgramiv(*program, GL_LINK_STATUS, &good);
        gl->GetProgramInfoLog(*program, sizeof message, NULL, message);
        status = good ? NACRE_OK : nacre_fail(error, "cannot draw a preview: %s", message);
    }
    gl->DeleteShader(shaders[0]);
    gl->DeleteShader(shaders[1]);
    return status;
}
