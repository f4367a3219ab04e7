// The bytes of resident bricks: each begins at a word and is as the store has it, which the CPU has
// checked. Numbers are little-endian, so are the machines that run this.

layout(std430, binding = 1) restrict readonly buffer Codes { uint codes[]; };

// Bits [bit, bit + count) counted from a word on; count is 0 to 32.
uint bits_at(int word, int bit, int count) {
    int shift = bit & 31;
    uint low = codes[word + (bit >> 5)];
    uint high = codes[word + ((bit + max(count, 1) - 1) >> 5)];  // of both, never beyond the bits
    return bitfieldExtract((low >> shift) | (high << 1 << (31 - shift)), 0, count);
}

uint byte_at(int word, int i) {
    return bitfieldExtract(codes[word + (i >> 2)], 8 * (i & 3), 8);
}
