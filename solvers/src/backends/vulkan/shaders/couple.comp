#version 460
// variants: f32.texel f32.storage f64.texel f64.storage
// Rows of a right-hand side from values at constrained vertices, b = -L_FC g: an invocation per row next to a constraint. Per
// row 12 bytes of indices and one vector written; per entry an index, a weight and one vector of g.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PLANES = 1;
layout(push_constant) uniform Push { uint count; };
READ_INDICES(0, rows)
READ_INDICES(1, starts)
READ_INDICES(2, constraints)
READ_TEXELS(3, weights)
READ_VECTORS(4, g)
layout(std430, binding = 5) writeonly buffer B { real4 b[]; };

void main() {
    uint i = group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (i >= count) return;
    uint end = starts_at(i + 1);
    real4 sum0 = real4(0), sum1 = real4(0);
    for (uint at = starts_at(i); at < end; at++) {
        texel w = weights_at(at / PACK);
        uint constraint = PLANES * constraints_at(at);
        sum0 -= w[at % PACK] * g_at(constraint);
        if (PLANES == 2) sum1 -= w[at % PACK] * g_at(constraint + 1);
    }
    uint row = PLANES * rows_at(i);
    b[row] = sum0;
    if (PLANES == 2) b[row + 1] = sum1;
}
