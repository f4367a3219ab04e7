// A vertex of a mesh: its place in the texture and in the picture.

in vec3 place_finest;  // in voxels of level 0: voxel i spans [i, i + 1]
in vec3 normal;        // in the world

uniform mat4 to_clip;

out vec3 corner_finest;
out vec3 corner_normal;

void main() {
    corner_finest = place_finest;
    corner_normal = normal;
    gl_Position = to_clip * vec4(place_finest, 1.0);
}
