#version 460
// variants: f32.texel f32.storage f64.texel f64.storage
// y of the pivots of one level: y[slot] = b[row] + sum of the children's updates. Per pivot 12 bytes of indices, b, the
// updates and y.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PLANES = 1;
layout(push_constant) uniform Push { uint first; uint count; uint fronts; };
READ_INDICES(0, rows)
READ_VECTORS(1, rhs)
READ_INDICES(2, starts)
READ_INDICES(3, sources)
READ_VECTORS(4, updates)
layout(std430, binding = 5) writeonly buffer Y { real4 y[]; };

void main() {
    uint i = group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (i >= count) return;
    uint slot = first + i;
    uint row = rows_at(slot);
    uint begin = starts_at(fronts + slot), end = starts_at(fronts + slot + 1);
    real4 sum0 = rhs_at(PLANES * row), sum1 = sum0;
    if (PLANES == 2) sum1 = rhs_at(2 * row + 1);
    for (uint at = begin; at < end; at++) {
        uint source = PLANES * sources_at(at);
        sum0 += updates_at(source);
        if (PLANES == 2) sum1 += updates_at(source + 1);
    }
    y[PLANES * slot] = sum0;
    if (PLANES == 2) y[2 * slot + 1] = sum1;
}
