// The rational Bézier curve across borders of blocks, along one axis (docs/spec/deblocking.md):
//
//     f(t) = Σ Bᵢ(t)·ωᵢ·Iᵢ / Σ Bᵢ(t)·ωᵢ         i = 0 … n − 1, over the voxels of two blocks
//
// An invocation reads the control points of one line across one border, and finds OUTPUTS points of
// the curve. What each differs from its voxel is added to that voxel's change.

layout(local_size_x = 8, local_size_y = 8) in;

layout(r32f, binding = 0) uniform image3D change;

#include "filtered.glsl"

const int AXIS = ${AXIS};
const int BLOCK = ${BLOCK};
const int OUTPUTS = ${OUTPUTS};
const int CHUNKS = (BLOCK + OUTPUTS - 1) / OUTPUTS;

uniform sampler3D weights;
uniform ivec3 box_low;
uniform ivec3 box_size;
uniform int first_border;  // the first voxel behind the first border; the others follow by blocks
uniform int count;         // n, control points
uniform int outputs;       // points of a curve
uniform float binomials[2 * BLOCK];
uniform vec2 ratios[CHUNKS * OUTPUTS];
#if !${DIRECT}
uniform float strength;
#endif

// A line across a border; points of its curve relative to its first control point, so that a
// constant line stays as it is.
struct Line {
    ivec3 first;  // texel of the first control point
    ivec3 step;
    float origin;
    int chunk;
};

#if ${DIRECT}
// By Horner's rule in t / (1 − t), in which all sums are of positive numbers.
float[OUTPUTS] points_of(Line line) {
    float above[OUTPUTS], below[OUTPUTS];
    for (int s = 0; s < OUTPUTS; ++s) above[s] = below[s] = 0.0;
    for (int i = count - 1; i >= 0; --i) {
        ivec3 texel = line.first + i * line.step;
        float weight = binomials[i] * texelFetch(weights, texel, 0).r;
        float product = weight * (value_at(texel) - line.origin);
        for (int s = 0; s < OUTPUTS; ++s) {
            float ratio = ratios[line.chunk * OUTPUTS + s].x;
            above[s] = above[s] * ratio + product;
            below[s] = below[s] * ratio + weight;
        }
    }
    float points[OUTPUTS];
    for (int s = 0; s < OUTPUTS; ++s) points[s] = line.origin + above[s] / below[s];
    return points;
}
#else
// Relative to the heaviest control point, whose own exponent is then 0 · strength.
float exponent(Line line, vec2 logs, int i, float heaviest) {
    float magnitude = texelFetch(weights, line.first + i * line.step, 0).r;
    float basis = binomials[i] + float(i) * logs.x + float(count - 1 - i) * logs.y;
    return basis - strength * (magnitude - heaviest);
}

float[OUTPUTS] points_of(Line line) {
    float heaviest = texelFetch(weights, line.first, 0).r;
    for (int i = 1; i < count; ++i) {
        float magnitude = texelFetch(weights, line.first + i * line.step, 0).r;
        heaviest = strength < 0.0 ? max(heaviest, magnitude) : min(heaviest, magnitude);
    }
    float points[OUTPUTS];
    for (int s = 0; s < OUTPUTS; ++s) {
        vec2 logs = ratios[line.chunk * OUTPUTS + s];
        float greatest = exponent(line, logs, 0, heaviest);
        for (int i = 1; i < count; ++i) greatest = max(greatest, exponent(line, logs, i, heaviest));
        float above = 0.0, below = 0.0;
        for (int i = 0; i < count; ++i) {
            float weight = exp(exponent(line, logs, i, heaviest) - greatest);
            above += weight * (value_at(line.first + i * line.step) - line.origin);
            below += weight;
        }
        points[s] = line.origin + above / below;
    }
    return points;
}
#endif

void main() {
    ivec3 id = ivec3(gl_GlobalInvocationID);
#if ${AXIS} == 0
    ivec3 across = ivec3(0, id.xy), step = ivec3(1, 0, 0);
#elif ${AXIS} == 1
    ivec3 across = ivec3(id.x, 0, id.y), step = ivec3(0, 1, 0);
#else
    ivec3 across = ivec3(id.xy, 0), step = ivec3(0, 0, 1);
#endif
    if (any(greaterThanEqual(across, box_size))) return;
    Line line;
    line.chunk = id.z % CHUNKS;
    line.step = step;
    int border = first_border + BLOCK * (id.z / CHUNKS);
    ivec3 first = (box_low + across) * (1 - step) + (border - BLOCK) * step;  // voxel of the level
    line.first = first - decoded_low;
    line.origin = value_at(line.first);
    float points[OUTPUTS] = points_of(line);
    for (int s = 0; s < OUTPUTS; ++s) {
        int output_number = line.chunk * OUTPUTS + s;
        ivec3 at = first + (BLOCK - BLOCK / 2 + output_number) * step;
        ivec3 in_box = at - box_low;
        if (output_number >= outputs || any(lessThan(in_box, ivec3(0))) ||
            any(greaterThanEqual(in_box, box_size)))
            continue;
        float moved = points[s] - value_at(at - decoded_low);
        imageStore(change, in_box, vec4(imageLoad(change, in_box).r + moved));
    }
}
