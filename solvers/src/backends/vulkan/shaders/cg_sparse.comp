#version 460
// variants: f32.texel f32.storage f64.texel f64.storage
// A sparse matrix times a block of four columns, a row per invocation: y = M x, b - M x, b + M x, or one step of a weighted
// Jacobi iteration, x + w (b - M x). Rows are chunks of four entries, the last one padded with zeros. Per chunk one word of
// four columns, four values and four rows of x.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint MODE = 0; // 0: M x, 1: b - M x, 2: b + M x, 3: x + w (b - M x)
layout(push_constant) uniform Push { uint count; };
READ_INDICES(0, starts)
READ_WORDS(1, columns)
READ_VECTORS(2, values)
READ_VECTORS(3, x)
READ_VECTORS(4, b)
READ_TEXELS(5, weights)
layout(std430, binding = 6) writeonly buffer Y { real4 y[]; };

void main() {
    uint i = group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (i >= count) return;
    real4 sum = real4(0);
    uint end = starts_at(i + 1);
    for (uint chunk = starts_at(i); chunk < end; chunk++) {
        uvec4 j = columns_at(chunk);
        real4 a = values_at(chunk);
        sum += a.x * x_at(j.x) + a.y * x_at(j.y) + a.z * x_at(j.z) + a.w * x_at(j.w);
    }
    if (MODE == 0) y[i] = sum;
    if (MODE == 1) y[i] = b_at(i) - sum;
    if (MODE == 2) y[i] = b_at(i) + sum;
    if (MODE == 3) {
        texel w = weights_at(i / PACK);
        y[i] = x_at(i) + w[i % PACK] * (b_at(i) - sum);
    }
}
