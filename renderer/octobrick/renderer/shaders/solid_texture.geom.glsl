// A triangle of a mesh, with what its fragments need to stay on it.
//
// Rasterisation moves vertices to a grid of parts of pixels and samples beside the triangle at its
// edges. Where a triangle is seen edge-on, a small part of a pixel is many voxels, and what is there
// need not be stored. So fragments get weights of the corners, which they can clamp, and not places.

layout(triangles) in;
layout(triangle_strip, max_vertices = 3) out;

in vec3 corner_finest[];
in vec3 corner_normal[];

flat out vec3 corner_a;
flat out vec3 corner_b;
flat out vec3 corner_c;
centroid out vec3 weights;
centroid out vec3 normal_world;

void main() {
    for (int i = 0; i < 3; ++i) {
        corner_a = corner_finest[0];
        corner_b = corner_finest[1];
        corner_c = corner_finest[2];
        weights = vec3(i == 0, i == 1, i == 2);
        normal_world = corner_normal[i];
        gl_Position = gl_in[i].gl_Position;
        EmitVertex();
    }
    EndPrimitive();
}
