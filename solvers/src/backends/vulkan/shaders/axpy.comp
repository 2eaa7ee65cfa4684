#version 460
// variants: f32.texel f32.storage f64.texel f64.storage
// y += a x, four columns per row. Reads 2, writes 1 vector per row.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(push_constant) uniform Push { uint count; float a; };
READ_VECTORS(0, x)
layout(std430, binding = 1) buffer Y { real4 y[]; };

void main() {
    uint i = group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (i < count) {
        y[i] += real(a) * x_at(i);
    }
}
