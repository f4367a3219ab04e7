// Samples of the volume's type in a brick's bytes.
#if ${IS_FLOAT}
#define SAMPLE float
#define SAMPLE_PAIR vec2
#else
#define SAMPLE int
#define SAMPLE_PAIR ivec2
#endif

const int SAMPLE_NBYTES = ${SAMPLE_NBYTES};
const bool IS_SIGNED = bool(${IS_SIGNED});

#if !${IS_FLOAT}
// The number in the low bits of a word.
int number(uint bits, bool is_signed) {
    return is_signed ? bitfieldExtract(int(bits), 0, 8 * SAMPLE_NBYTES)
                     : int(bitfieldExtract(bits, 0, 8 * SAMPLE_NBYTES));
}
#endif

// Sample i of those that begin at a word.
SAMPLE sample_at(int word, int i) {
#if ${IS_FLOAT}
    return uintBitsToFloat(codes[word + i]);
#else
    int bit = 8 * SAMPLE_NBYTES * i;
    return number(codes[word + (bit >> 5)] >> (bit & 31), IS_SIGNED);
#endif
}

// Samples 2i and 2i + 1.
SAMPLE_PAIR pair_at(int word, int i) {
#if ${IS_FLOAT}
    return vec2(sample_at(word, 2 * i), sample_at(word, 2 * i + 1));
#else
    int bit = 16 * SAMPLE_NBYTES * i;
    uint both = codes[word + (bit >> 5)] >> (bit & 31);
    return ivec2(number(both, IS_SIGNED), number(both >> (8 * SAMPLE_NBYTES), IS_SIGNED));
#endif
}
