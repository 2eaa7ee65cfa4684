#version 460
// variants: f32.texel f32.storage f64.texel f64.storage
// y = w b, a weight per row.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(push_constant) uniform Push { uint count; };
READ_VECTORS(0, b)
READ_TEXELS(1, weights)
layout(std430, binding = 2) writeonly buffer Y { real4 y[]; };

void main() {
    uint i = group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (i >= count) return;
    texel w = weights_at(i / PACK);
    y[i] = w[i % PACK] * b_at(i);
}
