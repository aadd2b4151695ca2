// A vertex of a lit surface, for the camera or for a light's map of depths.
uniform mat4 projection; // from the scene

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 light;

out vec3 side, baked;

void main()
{
    side = normal;
    baked = light;
    gl_Position = projection * vec4(position, 1);
}
