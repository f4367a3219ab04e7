// Where the parts of a zerobit code lie (docs/spec/zerobit.md), counted in bytes from its first
// word: header, codebook unless it is shared, thresholds, pointers, unit blocks of 16³ voxels.

const ivec3 BRICK = ivec3(${BRICK_XYZ});
const ivec3 UNITS = (BRICK + 15) / 16;
const int UNIT_COUNT = UNITS.x * UNITS.y * UNITS.z;
const int HEADER_NBYTES = 64;

// Where thresholds begin.
int thresholds_of(int word) {
    uint counts = codes[word + 5];  // of average and of detail codewords
    bool shared_book = byte_at(word, 7) == 1u;
    int codewords = int((counts & 0xffffu) + (counts >> 16));
    return HEADER_NBYTES + (shared_book ? 0 : codewords * SAMPLE_NBYTES);
}
