// Zerobit (docs/spec/zerobit.md): an invocation decodes a cell of 4³ voxels by two inverse Haar
// transforms, in 32-bit integers, or in double for float32. The codebook is in the code, or shared.

layout(local_size_x = 8, local_size_y = 8) in;

#include "decoded.glsl"
#include "codes.glsl"
#include "samples.glsl"
#include "stored.glsl"
#include "zerobit.glsl"

layout(std430, binding = 2) readonly buffer Codebook { uint codebook[]; };

#if ${IS_FLOAT}
#define SUM double
#define EXACT precise  // else a compiler may add in another order
#else
#define SUM int
#define EXACT
#endif

// Codeword i of those that begin at a word of the codebook; details are signed.
SUM codeword(int word, int i, bool is_signed) {
#if ${IS_FLOAT}
    return double(uintBitsToFloat(codebook[word + i]));
#else
    int bit = 8 * SAMPLE_NBYTES * i;
    return number(codebook[word + (bit >> 5)] >> (bit & 31), is_signed);
#endif
}

// What one cell has: where its next significance map and its next detail are, in bytes, and the
// code and codebook that they belong to.
struct Cell {
    int word;
    int book;     // the first word of the codebook
    int details;  // codewords before those of details
    int map_at;
    int detail_at;
};

// The node's average and, where it is not null, its details.
void read_node(inout Cell cell, bool is_null, SUM average, out SUM c[8]) {
    uint significance = is_null ? 0u : byte_at(cell.word, cell.map_at++);
    c[0] = average;
    for (int j = 1; j < 8; ++j) {
        c[j] = SUM(0);
        if (bitfieldExtract(significance, j - 1, 1) != 0u) {
            int index = int(byte_at(cell.word, cell.detail_at++));
            c[j] = codeword(cell.book, cell.details + index, true);
        }
    }
}

// The value of part i = 4z + 2y + x of a node: sums and differences of pairs along z, then y, then
// x, in this order, which decides the rounding of float32. Signs are factors: 8 branches would do
// the same, and take a compiler on a CPU a second.
SUM part_of(SUM c[8], int i) {
    SUM z = SUM(1 - 2 * (i >> 2)), y = SUM(1 - 2 * (i >> 1 & 1)), x = SUM(1 - 2 * (i & 1));
    EXACT SUM low = c[0] + z * c[1] + y * (c[2] + z * c[3]);
    EXACT SUM high = c[4] + z * c[5] + y * (c[6] + z * c[7]);
    EXACT SUM part = low + x * high;
    return part;
}

void put_voxel(Part part, ivec3 voxel, float stored) {
    bool inside = all(greaterThanEqual(voxel, ivec3(part.x_range.x, part.yz_range.xz))) &&
                  all(lessThan(voxel, ivec3(part.x_range.y, part.yz_range.yw)));
    if (inside) imageStore(slab, part.brick_in_slab.xyz + voxel, vec4(stored));
}

// 2³ voxels; within the least and the greatest sample of the header.
void put_node(Part part, ivec3 first, SUM c[8]) {
    SUM least = SUM(sample_at(part.code_words.x + 11, 0));
    SUM greatest = SUM(sample_at(part.code_words.x + 12, 0));
    for (int i = 0; i < 8; ++i) {
        EXACT SAMPLE voxel = SAMPLE(clamp(part_of(c, i), least, greatest));
        put_voxel(part, first + ivec3(i & 1, i >> 1 & 1, i >> 2), to_stored(voxel));
    }
}

void put_background(Part part, ivec3 first) {
    float stored = to_stored(sample_at(part.code_words.x + 8, 0));
    for (int i = 0; i < 64; ++i)
        put_voxel(part, first + ivec3(i & 3, i >> 2 & 3, i >> 4), stored);
}

uint u16_at(int word, int i) { return bits_at(word, 8 * i, 16); }
uint u32_at(int word, int i) { return bits_at(word, 8 * i, 32); }

void decode_cell(Part part, ivec3 first, int block, int place) {
    int word = part.code_words.x;
    uint count = byte_at(word, block);
    uvec2 flags = uvec2(0u);
    if (count > 0u) flags = uvec2(u32_at(word, block + 1), u32_at(word, block + 5));
    bool is_high = place >= 32;
    uint here = is_high ? flags.y : flags.x;
    if (bitfieldExtract(here, place & 31, 1) == 0u) {
        put_background(part, first);
        return;
    }
    int rank = bitCount(bitfieldExtract(here, 0, place & 31)) + (is_high ? bitCount(flags.x) : 0);
    int info = block + 9 + 5 * rank, streams = block + 9 + 5 * int(count);
    uint zerobits = u16_at(word, info + 3);
    int begin = streams + int(zerobits & 0x7fffu);
    uint nodes = byte_at(word, begin);  // bit i: node i + 1 has details

    Cell cell;
    cell.word = word;
    cell.book = part.code_words.y;
    cell.details = int(codes[word + 5] & 0xffffu);
    cell.map_at = begin + 1;
    cell.detail_at = streams + int(u16_at(word, info + 1));
    SUM average = codeword(cell.book, int(byte_at(word, info)), IS_SIGNED);
    SUM parents[8], c[8];
    read_node(cell, (zerobits & 0x8000u) == 0u, average, parents);
    int node_count = min(8 * int(count), 8);  // 8; but a loop that is not unrolled compiles sooner
    for (int i = 0; i < node_count; ++i) {
        read_node(cell, bitfieldExtract(nodes, i, 1) == 0u, part_of(parents, i), c);
        put_node(part, first + 2 * ivec3(i & 1, i >> 1 & 1, i >> 2), c);
    }
}

void main() {
    ivec3 at = 4 * ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(at.xy, part_size.xy))) return;
    Part part = parts[at.z / part_size.z];
    ivec3 first = part.first_in_brick.xyz + ivec3(at.xy, at.z % part_size.z);
    ivec3 unit = first / 16, in_unit = first / 4 % 4;
    int number_of_unit = (unit.z * UNITS.y + unit.y) * UNITS.x + unit.x;
    int pointers = thresholds_of(part.code_words.x) + UNIT_COUNT;
    int blocks = pointers + 4 * UNIT_COUNT;
    int block = blocks + int(u32_at(part.code_words.x, pointers + 4 * number_of_unit));
    decode_cell(part, first, block, 16 * in_unit.z + 4 * in_unit.y + in_unit.x);
}
