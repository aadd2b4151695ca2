/* OpenGL without a window system: Mesa's off-screen library, loaded when it is needed. It is not linked, because it
 * defines the same functions as the OpenGL ES library of the projector. */
#ifndef RENDER_OSMESA_H
#define RENDER_OSMESA_H

#include "nacre/error.h"

#include <GL/glcorearb.h>

/* The functions of OpenGL that are used, by their names in upper case, as in its own header. */
#define OSMESA_FUNCTIONS(X)                                                                        \
    X(ATTACHSHADER, AttachShader)                                                                  \
    X(ACTIVETEXTURE, ActiveTexture)                                                                \
    X(BINDBUFFER, BindBuffer)                                                                      \
    X(BINDFRAMEBUFFER, BindFramebuffer)                                                            \
    X(BINDRENDERBUFFER, BindRenderbuffer)                                                          \
    X(BINDTEXTURE, BindTexture)                                                                    \
    X(BINDVERTEXARRAY, BindVertexArray)                                                            \
    X(BUFFERDATA, BufferData)                                                                      \
    X(CHECKFRAMEBUFFERSTATUS, CheckFramebufferStatus)                                              \
    X(CLEAR, Clear)                                                                                \
    X(CLEARCOLOR, ClearColor)                                                                      \
    X(COMPILESHADER, CompileShader)                                                                \
    X(CREATEPROGRAM, CreateProgram)                                                                \
    X(CREATESHADER, CreateShader)                                                                  \
    X(DELETESHADER, DeleteShader)                                                                  \
    X(DISABLE, Disable)                                                                            \
    X(DRAWARRAYS, DrawArrays)                                                                      \
    X(DRAWBUFFER, DrawBuffer)                                                                      \
    X(DRAWBUFFERS, DrawBuffers)                                                                    \
    X(DRAWELEMENTS, DrawElements)                                                                  \
    X(ENABLE, Enable)                                                                              \
    X(ENABLEVERTEXATTRIBARRAY, EnableVertexAttribArray)                                            \
    X(FRAMEBUFFERRENDERBUFFER, FramebufferRenderbuffer)                                            \
    X(FRAMEBUFFERTEXTURE2D, FramebufferTexture2D)                                                  \
    X(FRAMEBUFFERTEXTURELAYER, FramebufferTextureLayer)                                            \
    X(GENBUFFERS, GenBuffers)                                                                      \
    X(GENFRAMEBUFFERS, GenFramebuffers)                                                            \
    X(GENRENDERBUFFERS, GenRenderbuffers)                                                          \
    X(GENTEXTURES, GenTextures)                                                                    \
    X(GENVERTEXARRAYS, GenVertexArrays)                                                            \
    X(GETERROR, GetError)                                                                          \
    X(GETINTEGERV, GetIntegerv)                                                                    \
    X(GETPROGRAMINFOLOG, GetProgramInfoLog)                                                        \
    X(GETPROGRAMIV, GetProgramiv)                                                                  \
    X(GETSHADERINFOLOG, GetShaderInfoLog)                                                          \
    X(GETSHADERIV, GetShaderiv)                                                                    \
    X(GETSTRING, GetString)                                                                        \
    X(GETUNIFORMLOCATION, GetUniformLocation)                                                      \
    X(LINKPROGRAM, LinkProgram)                                                                    \
    X(PIXELSTOREI, PixelStorei)                                                                    \
    X(READBUFFER, ReadBuffer)                                                                      \
    X(READPIXELS, ReadPixels)                                                                      \
    X(RENDERBUFFERSTORAGE, RenderbufferStorage)                                                    \
    X(SHADERSOURCE, ShaderSource)                                                                  \
    X(STENCILFUNC, StencilFunc)                                                                    \
    X(STENCILOP, StencilOp)                                                                        \
    X(TEXIMAGE2D, TexImage2D)                                                                      \
    X(TEXIMAGE3D, TexImage3D)                                                                      \
    X(TEXPARAMETERI, TexParameteri)                                                                \
    X(TEXSUBIMAGE3D, TexSubImage3D)                                                                \
    X(UNIFORM1F, Uniform1f)                                                                        \
    X(UNIFORM1I, Uniform1i)                                                                        \
    X(UNIFORM1IV, Uniform1iv)                                                                      \
    X(UNIFORM2F, Uniform2f)                                                                        \
    X(UNIFORM3F, Uniform3f)                                                                        \
    X(UNIFORM3I, Uniform3i)                                                                        \
    X(UNIFORMMATRIX4FV, UniformMatrix4fv)                                                          \
    X(USEPROGRAM, UseProgram)                                                                      \
    X(VERTEXATTRIBPOINTER, VertexAttribPointer)                                                    \
    X(VIEWPORT, Viewport)

struct osmesa {
#define OSMESA_MEMBER(upper, name) PFNGL##upper##PROC name;
    OSMESA_FUNCTIONS(OSMESA_MEMBER)
#undef OSMESA_MEMBER
    void *context;          /* private */
    unsigned char *surface; /* private: what OSMesa wants to draw on */
};

/* Load the library and make a context current in this thread. osmesa_close it whatever is returned. */
int osmesa_open(struct osmesa *gl, struct nacre_error *error);
void osmesa_close(struct osmesa *gl);

#endif
