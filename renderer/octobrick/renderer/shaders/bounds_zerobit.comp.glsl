// The scale of the error of every cell of zerobit: twice the threshold of its unit block.

layout(local_size_x = 8, local_size_y = 8) in;

#include "decoded.glsl"
#include "codes.glsl"
#include "samples.glsl"
#include "bound.glsl"
#include "zerobit.glsl"

void main() {
    Work work = find_work();
    if (work.rows == 0) return;
    int word = work.part.code_words.x;
    ivec3 unit = work.first / 4;
    int number_of_unit = (unit.z * UNITS.y + unit.y) * UNITS.x + unit.x;
    uint threshold = byte_at(word, thresholds_of(word) + number_of_unit);
    float step = uintBitsToFloat(codes[word + 13]);
    put(work, work.first, filter_bound(2.0 * (float(threshold) * step)));
}
