// What all forms of S3Dc share (claims S1, S2): from an index to the voxel between the end points
// of its block, with L = 2^width − 1.
//
//     integers  v = min + (2·R·index + L) div (2·L)        R = max − min
//     float32   v = min + R·index / L                       in double, rounded once; max at L

#if ${IS_FLOAT}
float between(vec2 ends, uint index, uint levels) {
    precise double low = double(ends.x);
    precise double high = double(ends.y);
    precise double value = low + (high - low) * double(index) / double(levels);
    return index == levels ? ends.y : clamp(float(value), ends.x, ends.y);
}
#else
// At 14 bits the sum has 31 bits and more, so it has no sign.
int between(ivec2 ends, uint index, uint levels) {
    return ends.x + int((2u * uint(ends.y - ends.x) * index + levels) / (2u * levels));
}
#endif

// The number of the block that a voxel lies in.
int block_of(ivec3 voxel, ivec3 block_size, ivec3 blocks) {
    ivec3 block = voxel / block_size;
    return (block.z * blocks.y + block.y) * blocks.x + block.x;
}
