// The light that leaves what a pixel sees towards the camera: what was calculated beforehand, and what lights without extent
// add with shadows from maps of depths, as POV-Ray is told in pov.c. Lengths in mm.
const int LIGHTS = 8;

struct Light {
    vec3 position, right, up, forward;
    vec3 intensity;
    float cos_full, cos_edge; // full light within, none without; below -1: in all directions
    bool lambert;             // less by Lambert's law
    vec2 tangents;            // half extents of the picture at unit distance
    vec2 slide;               // its share of the slides' common width and height
    int layers[6];            // of the map of depths that look forward, right, left, up, down, back; -1: none
};

layout(early_fragment_tests) in; // pixels of other surfaces are left out

uniform sampler2D seen_light, seen_normal; // preview_seen.frag
uniform vec3 eye, ahead, rightwards, upwards; // to the picture's middle, right and upper side at unit depth
uniform vec2 half_size; // of the picture, pixels
uniform float number;
uniform float exposure;
uniform vec3 colour; // of a plain surface
uniform float specular, roughness;
uniform float index; // of refraction; 1: light leaves alike in all directions
// PICTURES, END, TRANSLUCENT, BOUNDED (an index of refraction) and ROUND (a light's shadows need more than one map) are defined in front of this, for each kind of surface:
// llvmpipe goes through the body of a loop or an `if` whether or not a pixel takes it. Lights that cast pictures come
// first, up to PICTURES, then others, up to END.
uniform Light lights[LIGHTS];
uniform sampler2DArray slides; // one a light
uniform sampler2DArrayShadow depths;
uniform float depth_tangent;       // half extent of a map at unit distance
uniform vec2 depth_planes;         // nearest and farthest distance in a map
uniform float depth_texel;         // width of a map's texel at unit distance

out vec4 result;

vec3 picture(int number, vec3 direction)
{
    float along = dot(direction, lights[number].forward);
    vec2 at = vec2(dot(direction, lights[number].right), -dot(direction, lights[number].up));
    at = at / along / lights[number].tangents;
    if (along <= 0 || any(greaterThan(abs(at), vec2(1)))) {
        return vec3(0);
    }
    vec2 margin = 0.5 / vec2(textureSize(slides, 0).xy);
    at = clamp((at + 1) / 2 * lights[number].slide, margin, lights[number].slide - margin);
    return textureLod(slides, vec3(at, number), 0).rgb;
}

float cone(int number, vec3 direction)
{
    float width = max(lights[number].cos_full - lights[number].cos_edge, 1e-6);
    float t = clamp((dot(direction, lights[number].forward) - lights[number].cos_edge) / width, 0, 1);
    float along = dot(direction, lights[number].forward);
    return t * t * (3 - 2 * t) * (lights[number].lambert ? max(along, 0) : 1);
}

// The share of the light that nothing is in the way of.
float visible(int number, vec3 point, vec3 normal)
{
    vec3 way = point - lights[number].position;
    vec3 d = vec3(dot(way, lights[number].right), dot(way, lights[number].up), dot(way, lights[number].forward));
    vec3 size = abs(d);
    // On the side that the light is on, by what a texel spans there.
    point += normal * sign(dot(normal, -way)) * 2 * depth_texel * max(size.x, max(size.y, size.z));
    way = point - lights[number].position;
    d = vec3(dot(way, lights[number].right), dot(way, lights[number].up), dot(way, lights[number].forward));
    size = abs(d);
    int face = 0;
    vec3 seen = d; // right, up, forward in the map
    if (!ROUND) {
    } else if (size.z >= size.x && size.z >= size.y) {
        face = d.z > 0 ? 0 : 5;
        seen = d.z > 0 ? d : vec3(-d.x, d.y, -d.z);
    } else if (size.x >= size.y) {
        face = d.x > 0 ? 1 : 2;
        seen = d.x > 0 ? vec3(-d.z, d.y, d.x) : vec3(d.z, d.y, -d.x);
    } else {
        face = d.y > 0 ? 3 : 4;
        seen = d.y > 0 ? vec3(d.x, -d.z, d.y) : vec3(d.x, d.z, -d.y);
    }
    int layer = lights[number].layers[face];
    if (layer < 0) {
        return 1.0;
    }
    float n = depth_planes.x, f = depth_planes.y;
    float depth = ((f + n) / (f - n) - 2 * f * n / (f - n) / seen.z + 1) / 2;
    vec2 at = (seen.xy / seen.z / depth_tangent + 1) / 2;
    return texture(depths, vec4(at, layer, depth));
}

// What a light adds that is of this colour in the direction of the place.
vec3 added(int number, vec3 place, vec3 direction, vec3 shade, vec3 normal, vec3 view)
{
    vec3 way = place - lights[number].position;
    float cosine = -dot(direction, normal);
    vec3 arriving = lights[number].intensity * shade / dot(way, way) * visible(number, place, normal);
    float highlight = specular * pow(max(dot(normalize(view - direction), normal), 0), 1 / roughness);
    return cosine > 0 ? arriving * (highlight + (TRANSLUCENT ? vec3(0) : colour * cosine)) : vec3(0);
}

// As in fresnel.h: 1 along the normal, 0 where light grazes.
float transmitted(float cosine)
{
    float inside = sqrt(1 - (1 - cosine * cosine) / (index * index)), amplitude = (index - 1) / (index + 1);
    float s = (cosine - index * inside) / (cosine + index * inside);
    float p = (inside - index * cosine) / (inside + index * cosine);
    return (1 - (s * s + p * p) / 2) / (1 - amplitude * amplitude);
}

void main()
{
    vec4 light = texelFetch(seen_light, ivec2(gl_FragCoord.xy), 0);
    vec4 side = texelFetch(seen_normal, ivec2(gl_FragCoord.xy), 0);
    if (light.a != number) {
        discard;
    }
    vec2 at = gl_FragCoord.xy / half_size - 1;
    vec3 way = side.w * (ahead + at.x * rightwards + at.y * upwards), place = eye + way;
    vec3 normal = normalize(side.xyz), view = -normalize(way);
    vec3 sum = TRANSLUCENT ? light.rgb : colour * light.rgb;
    if (BOUNDED) {
        float cosine = dot(normal, view);
        sum *= cosine > 0 ? transmitted(min(cosine, 1.0)) : 0.0;
    }
    normal *= dot(normal, view) < 0 ? -1 : 1; // POV-Ray lights the side that is seen
    for (int i = 0; i < PICTURES; i++) {
        vec3 direction = normalize(place - lights[i].position);
        sum += added(i, place, direction, picture(i, direction), normal, view);
    }
    for (int i = PICTURES; i < END; i++) {
        vec3 direction = normalize(place - lights[i].position);
        sum += added(i, place, direction, vec3(cone(i, direction)), normal, view);
    }
    result = vec4(sum * exposure, 1);
}
