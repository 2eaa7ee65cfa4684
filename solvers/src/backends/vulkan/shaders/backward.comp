#version 460
// variants: f32.texel f32.storage f32.shuffle f64.texel f64.storage f64.shuffle
// One tile of the backward sweep: x = X^T (X y) - M^T x_above for some pivots of a block. x of the rows above was written
// by earlier dispatches.
#extension GL_GOOGLE_include_directive : require
#ifndef READ_storage
#extension GL_KHR_shader_subgroup_shuffle : require
#endif
#include "common.glsl"
#include "multiply.glsl"

layout(push_constant) uniform Push { uint first; uint count; uint base; uint none; };
READ_WORDS(0, tiles)
READ_TEXELS(1, values)
READ_VECTORS(2, fronts)
READ_INDICES(3, rows)
READ_INDICES(4, below)
READ_VECTORS(5, above)
layout(std430, binding = 6) writeonly buffer X { real4 x[]; };

#define OWN(K, PLANE) fronts_at(PLANES * (element + K) + PLANE)
#define ABOVE(K, PLANE) above_at(PLANES * (K < columns ? below_at(start + K) : none) + PLANE)

void main() {
    uint tile = tile_index();
    bool idle = tile >= count;
    if (WAYS == 1 && idle) return;
    uint head_at = 2 * (first + (idle ? 0 : tile));
    uvec4 head = tiles_at(head_at), more = tiles_at(head_at + 1);
    uint element = head.x, own = head.y & 0x7FFFFFF, height = (head.y >> 27) + 1;
    uint at = head.z - base + lane;
    uint start = more.x, columns = more.y;
    clear();
    MULTIPLY(at, own, OWN)
    at = AFTER(at, own);
    MULTIPLY(at, columns, ABOVE)
    sum_ways();
    if (idle || way > 0) return;
    [[unroll]] for (uint r = 0; r < MOST_ROWS; r++) {
        if (r < ROWS && LANES * r + lane < height) {
            uint row = rows_at(head.w + LANES * r + lane);
            x[PLANES * row] = acc[r];
            if (PLANES == 2) x[2 * row + 1] = acc[MOST_ROWS + r];
        }
    }
}
