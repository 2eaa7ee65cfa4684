#version 460
// variants: f32.texel f32.storage f64.texel f64.storage
// One tile of the forward sweep: rows of [X; -M] times y of the block, added to the children's updates of its rows
// below. With LEAVES the blocks have no children and y is the right-hand side itself, gathered row by row.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "multiply.glsl"

layout(constant_id = 3) const uint LEAVES = 0;
layout(push_constant) uniform Push { uint first; uint count; uint base; };
READ_WORDS(0, tiles)
READ_TEXELS(1, values)
READ_VECTORS(2, y) // the right-hand side for leaves
READ_INDICES(3, rows)
READ_INDICES(4, starts)
READ_INDICES(5, sources)
READ_VECTORS(6, updates)
layout(std430, binding = 7) writeonly buffer Fronts { real4 fronts[]; };

#define OWN(K, PLANE) y_at(PLANES * (LEAVES == 1 ? rows_at(slot + K) : slot + K) + PLANE)

void main() {
    uint lane = gl_LocalInvocationID.x % LANES;
    uint tile = (group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x) / LANES;
    if (tile >= count) return;
    uvec4 head = tiles_at(first + tile);
    uint slot = head.x, columns = head.y & 0x7FFFFFF, height = (head.y >> 27) + 1;
    uint at = head.z - base + lane;
    clear();
    MULTIPLY(at, columns, OWN)
    [[unroll]] for (uint r = 0; r < MOST_ROWS; r++) {
        if (r < ROWS && LANES * r + lane < height) {
            uint element = head.w + LANES * r + lane;
            real4 sum0 = acc[r], sum1 = acc[MOST_ROWS + r];
            if (LEAVES == 0) {
                uint begin = starts_at(element), end = starts_at(element + 1);
                for (uint s = begin; s < end; s++) {
                    uint source = PLANES * sources_at(s);
                    sum0 += updates_at(source);
                    if (PLANES == 2) sum1 += updates_at(source + 1);
                }
            }
            fronts[PLANES * element] = sum0;
            if (PLANES == 2) fronts[2 * element + 1] = sum1;
        }
    }
}
