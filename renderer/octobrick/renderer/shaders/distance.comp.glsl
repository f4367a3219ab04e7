// One axis of the separable Chebyshev distance: D'(x) = min over o of max(|o|, D(x + o)).

layout(local_size_x = 8, local_size_y = 8) in;

layout(r8ui, binding = 0) uniform writeonly uimage3D farther;

uniform usampler3D nearer;
uniform ivec3 axis;
uniform ivec3 cell_count;

const int REACH = ${REACH};

void main() {
    ivec3 at = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(at, cell_count))) return;
    uint nearest = uint(REACH + 1);
    for (int offset = -REACH; offset <= REACH; ++offset) {
        ivec3 other = at + offset * axis;
        // Beyond the slab no sample of this slab is taken: as good as empty.
        if (all(greaterThanEqual(other, ivec3(0))) && all(lessThan(other, cell_count)))
            nearest = min(nearest, max(uint(abs(offset)), texelFetch(nearer, other, 0).r));
    }
    imageStore(farther, at, uvec4(nearest));
}
