#version 460
// variants: f32.texel f32.storage f64.texel f64.storage
// x += alpha p, r -= alpha q, and partial sums of r . r as in cg_dots.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint ROWS = 32;
layout(push_constant) uniform Push { uint count; uint slots; };
READ_VECTORS(0, p)
READ_VECTORS(1, q)
READ_VECTORS(2, state)
layout(std430, binding = 3) buffer X { real4 x[]; };
layout(std430, binding = 4) buffer R { real4 r[]; };
layout(std430, binding = 5) writeonly buffer Partials { real4 partials[]; };

void main() {
    uint group = group_index();
    uint first = group * gl_WorkGroupSize.x * ROWS + gl_LocalInvocationID.x;
    real4 alpha = state_at(3);
    real4 sum = real4(0);
    for (uint k = 0; k < ROWS; k++) {
        uint i = first + k * gl_WorkGroupSize.x;
        if (i < count) {
            x[i] += alpha * p_at(i);
            real4 residual = r[i] - alpha * q_at(i);
            r[i] = residual;
            sum += residual * residual;
        }
    }
    uint slot = group * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (slot < slots) partials[slot] = sum;
}
