// What a pixel sees, to be lit once all is drawn: triangles are as small as pixels, and OpenGL shades 4 x 4 of them for each.
uniform float number; // of the surface, from 1

in vec3 side, baked;
layout(location = 0) out vec4 light; // and the number
layout(location = 1) out vec4 normal; // not of unit length, and the depth along the view

void main()
{
    light = vec4(baked, number);
    normal = vec4(side, 1 / gl_FragCoord.w);
}
