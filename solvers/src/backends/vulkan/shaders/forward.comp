#version 460
// variants: f32.texel f32.storage f32.shuffle f64.texel f64.storage f64.shuffle
// One tile of the forward sweep: rows of [X; -M] times y of the block, added to the children's updates of its rows below.
#extension GL_GOOGLE_include_directive : require
#ifndef READ_storage
#extension GL_KHR_shader_subgroup_shuffle : require
#endif
#include "common.glsl"
#include "multiply.glsl"

// Where y comes from: 0: it was assembled; 1: a leaf's is the right-hand side, gathered row by row; 2: right-hand side and
// updates of the children are gathered here, as `assemble` does it.
layout(constant_id = 6) const uint SOURCE = 0;
layout(push_constant) uniform Push { uint first; uint count; uint base; uint all_fronts; };
READ_WORDS(0, tiles)
READ_TEXELS(1, values)
READ_VECTORS(2, y) // the right-hand side unless assembled
READ_INDICES(3, rows)
READ_INDICES(4, starts)
READ_INDICES(5, sources)
READ_VECTORS(6, updates)
layout(std430, binding = 7) writeonly buffer Fronts { real4 fronts[]; };

// Adds the updates that go to `element`: fronts first, then slots.
real4 updated(real4 sum, uint element, uint plane) {
    uint begin = starts_at(element), end = starts_at(element + 1);
    for (uint s = begin; s < end; s++) sum += updates_at(PLANES * sources_at(s) + plane);
    return sum;
}

real4 own_y(uint slot, bool inside, uint plane) {
    if (SOURCE == 0) return y_at(PLANES * slot + plane);
    real4 b = y_at(PLANES * rows_at(slot) + plane);
    if (SOURCE == 1) return b;
    return inside ? updated(b, all_fronts + slot, plane) : real4(0); // updates of the next level are being written
}

#define OWN(K, PLANE) own_y(slot + K, K < columns, PLANE)

// Row R of the lane. Not a loop: drivers do not unroll one around another and would keep acc in memory.
#define FINISH(R) \
    if (R < ROWS && LANES * R + lane < height) { \
        uint element = head.w + LANES * R + lane; \
        real4 sum0 = acc[R], sum1 = acc[MOST_ROWS + R]; \
        if (SOURCE != 1) { \
            sum0 = updated(sum0, element, 0); \
            if (PLANES == 2) sum1 = updated(sum1, element, 1); \
        } \
        fronts[PLANES * element] = sum0; \
        if (PLANES == 2) fronts[2 * element + 1] = sum1; \
    }

void main() {
    uint tile = tile_index();
    bool idle = tile >= count;
    if (WAYS == 1 && idle) return;
    uvec4 head = tiles_at(first + (idle ? 0 : tile));
    uint slot = head.x, columns = head.y & 0x7FFFFFF, height = (head.y >> 27) + 1;
    uint at = head.z - base + lane;
    clear();
    MULTIPLY(at, columns, OWN)
    sum_ways();
    if (idle || way > 0) return;
    FINISH(0)
    FINISH(1)
    FINISH(2)
    FINISH(3)
}
