// The colour of a fragment: its place in the texture leads to a tile, that to a slot of the atlas.

#include "shading.glsl"

#define LINEAR ${LINEAR}
#define FUNCTION ${FUNCTION}
#define LIT ${LIT}

const int TILE = ${TILE};
const int BORDER = ${BORDER};
const int SIDE = TILE + 2 * BORDER;
const int ENTRIES = ${ENTRIES};

flat in vec3 corner_a;  // of the triangle, in voxels of level 0
flat in vec3 corner_b;
flat in vec3 corner_c;
centroid in vec3 weights;  // of its corners
centroid in vec3 normal_world;

layout(location = 0) out vec4 color;

uniform sampler3D atlas;
uniform usampler3D slot_of_tile;  // one more than the slot; 0 where there is none
uniform ivec2 slots;              // along x and y
uniform ivec3 level_size;
uniform float level_scale;     // voxels of the level shown per voxel of level 0
uniform float outside_voxels;  // a place further away from the level than this has no texture
uniform vec3 without_texture;
uniform sampler2D function;  // entries of a transfer function, over the window

uniform vec3 voxel_world;           // size of a voxel of level 0
uniform vec3 first_from_eye_world;  // its first corner, seen from the eye
uniform vec3 forward_world;
uniform bool is_perspective;

vec4 texel(vec3 at) {
    vec3 inside = clamp(at, vec3(0.5), vec3(level_size) - 0.5);
    ivec3 voxel = min(ivec3(inside), level_size - 1);
    ivec3 tile = voxel / TILE;
    int slot = int(texelFetch(slot_of_tile, tile, 0).r) - 1;
    bool is_outside = any(greaterThan(abs(at - inside), vec3(0.5 + outside_voxels)));
    if (slot < 0 || is_outside) return vec4(0.0, 0.0, 0.0, -1.0);
    ivec3 corner = ivec3(slot % slots.x, slot / slots.x % slots.y, slot / (slots.x * slots.y));
    ivec3 first = corner * SIDE + BORDER - tile * TILE;
#if LINEAR
    return vec4(texture(atlas, (vec3(first) + inside) / vec3(textureSize(atlas, 0))).rgb, 1.0);
#else
    return vec4(texelFetch(atlas, first + voxel, 0).rgb, 1.0);
#endif
}

vec3 entry(int index) {
    return texelFetch(function, ivec2(index % 1024, index / 1024), 0).rgb;
}

void main() {
    vec3 inside = clamp(weights, 0.0, 1.0);
    inside /= inside.x + inside.y + inside.z;
    vec3 finest_voxel = inside.x * corner_a + inside.y * corner_b + inside.z * corner_c;
    vec4 found = texel(finest_voxel * level_scale);
    vec3 own = found.rgb;
#if FUNCTION
    float at = clamp(found.r, 0.0, 1.0) * float(ENTRIES - 1);
    int low = min(int(at), ENTRIES - 2);
    own = mix(entry(low), entry(low + 1), at - float(low));
#endif
    if (found.a < 0.0) own = without_texture;
    color = vec4(own, 1.0);
#if LIT
    vec3 from_eye = finest_voxel * voxel_world + first_from_eye_world;
    vec3 toward = is_perspective ? normalize(from_eye) : forward_world;
    color = shade(color, normal_world, toward);
#endif
}
