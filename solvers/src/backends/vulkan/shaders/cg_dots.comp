#version 460
// variants: f32.texel f32.storage f64.texel f64.storage
// Partial sums of a . b, column by column: one per invocation, over ROWS rows a workgroup's width apart.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint ROWS = 32;
layout(push_constant) uniform Push { uint count; uint slots; };
READ_VECTORS(0, a)
READ_VECTORS(1, b)
layout(std430, binding = 2) writeonly buffer Partials { real4 partials[]; };

void main() {
    uint group = group_index();
    uint first = group * gl_WorkGroupSize.x * ROWS + gl_LocalInvocationID.x;
    real4 sum = real4(0);
    for (uint k = 0; k < ROWS; k++) {
        uint i = first + k * gl_WorkGroupSize.x;
        if (i < count) sum += a_at(i) * b_at(i);
    }
    uint slot = group * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (slot < slots) partials[slot] = sum;
}
