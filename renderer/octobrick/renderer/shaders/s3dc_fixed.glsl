// Where the parts of an S3Dc code at a fixed rate lie (docs/spec/s3dc.md): end points of all
// blocks; an index of BITS bits for each voxel, packed along x, lowest bits first, in rows of whole
// 16-bit words; and, where scales are trained, eight of them and four bits per block that choose.

const int BITS = ${BITS};
const uint LEVELS = (1u << BITS) - 1u;
const ivec3 BRICK = ivec3(${BRICK_XYZ});
const ivec3 BLOCK = ivec3(${BLOCK_XYZ});
const ivec3 BLOCKS = (BRICK + BLOCK - 1) / BLOCK;
const int ROW_NBITS = (BRICK.x * BITS + 15) / 16 * 16;
const int ROWS_BIT = 16 * SAMPLE_NBYTES * BLOCKS.x * BLOCKS.y * BLOCKS.z;

#if ${SCALED}
const int SCALES_BIT = ROWS_BIT + BRICK.z * BRICK.y * ROW_NBITS;
const int CHOICES_BIT = SCALES_BIT + 8 * 16 * (1 << BITS);

// Where the positions of a block's scale begin.
int scale_bit(int word, int block) {
    int choice = int(bits_at(word, CHOICES_BIT + 4 * block, 3));
    return SCALES_BIT + 16 * (choice << BITS);
}
#else
int scale_bit(int word, int block) { return 0; }
#endif
