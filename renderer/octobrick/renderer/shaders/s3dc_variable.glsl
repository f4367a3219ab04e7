// Where the parts of an S3Dc code with a width per block lie (docs/spec/s3dc-variable.md): end
// points; for every eight blocks the units before them and eight widths of four bits; and payload,
// of which a block takes as many units as it has bits per index.

const ivec3 BRICK = ivec3(${BRICK_XYZ});
const ivec3 BLOCK = ivec3(${BLOCK_XYZ});
const ivec3 BLOCKS = (BRICK + BLOCK - 1) / BLOCK;
const int BLOCK_COUNT = BLOCKS.x * BLOCKS.y * BLOCKS.z;
const int GROUPS = (2 * SAMPLE_NBYTES * BLOCK_COUNT + 3) / 4;
const int UNIT = (BLOCK.x * BLOCK.y * BLOCK.z + 31) / 32;
const int PAYLOAD = GROUPS + 2 * ((BLOCK_COUNT + 7) / 8);  // all in words
const int RAW = 15;

int width_of(int word, int block) {
    return int(bitfieldExtract(codes[word + GROUPS + 2 * (block >> 3) + 1], 4 * (block & 7), 4));
}

// Units that the widths of a group's blocks before one take: at most seven additions.
int units_before(uint widths, int place) {
    int units = 0;
    for (int i = 0; i < place; ++i, widths >>= 4) {
        int width = int(widths & 15u);
        units += width == RAW ? 8 * SAMPLE_NBYTES : width;
    }
    return units;
}

// The first word of a block's payload.
int payload_of(int word, int block) {
    int group = word + GROUPS + 2 * (block >> 3);
    return word + PAYLOAD + UNIT * (int(codes[group]) + units_before(codes[group + 1], block & 7));
}
