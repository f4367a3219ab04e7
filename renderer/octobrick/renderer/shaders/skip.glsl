// Leaping over cells in which nothing can be seen.

uniform usampler3D emptiness;       // per cell: 0, or cells to the nearest that is not empty
uniform ivec3 cell_origin;
uniform vec3 volume_voxels;         // size of the level

const ivec3 CELL = ivec3(${CELL_XYZ});
const float SHY = 0.0625;  // samples by which skipping stops early rather than late

ivec3 cell_of(vec3 p) {
    return clamp(ivec3(floor(p - 0.5)), ivec3(0), ivec3(volume_voxels) - 1) / CELL;
}

int emptiness_at(ivec3 cell) { return int(texelFetch(emptiness, cell - cell_origin, 0).r); }

// Samples per voxel along each axis. Axes that the ray does not move along get a huge value of
// finite products.
vec3 samples_per_voxel(Ray ray) {
    vec3 moving = max(abs(ray.step_voxel), vec3(PARALLEL));
    return mix(vec3(1), vec3(-1), lessThan(ray.step_voxel, vec3(0))) / moving;
}

// The first sample that may lie outside the cells within `reach` of a cell.
int leave(Ray ray, vec3 per_voxel, ivec3 cell, int reach, int k) {
    vec3 low = vec3((cell - reach) * CELL) + 0.5;
    vec3 high = vec3((cell + reach + 1) * CELL) + 0.5;
    vec3 exit = (mix(low, high, greaterThan(per_voxel, vec3(0))) - ray.start_voxel) * per_voxel;
    float nearest = min(min(exit.x, exit.y), exit.z) - 0.5 - SHY;
    return max(k + 1, int(ceil(min(nearest, float(SAMPLES_MAX)))));
}
