// The decoded voxels of a box of the level and its margin, which deblocking reads: in values above
// the type's lowest, or, for float32, as stored.

uniform sampler3D decoded;
uniform ivec3 decoded_low;  // the voxel of the level that texel (0, 0, 0) holds

float value_at(ivec3 texel) {
    float stored = texelFetch(decoded, texel, 0).r;
#if ${IS_FLOAT}
    return stored;
#else
    return round(stored * float(${HIGHEST_STORED}));
#endif
}
