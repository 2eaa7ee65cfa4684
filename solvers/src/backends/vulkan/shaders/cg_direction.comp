#version 460
// variants: f32.texel f32.storage f64.texel f64.storage
// p = z + beta p.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(push_constant) uniform Push { uint count; };
READ_VECTORS(0, z)
READ_VECTORS(1, state)
layout(std430, binding = 2) buffer P { real4 p[]; };

void main() {
    uint i = group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (i < count) p[i] = z_at(i) + state_at(4) * p[i];
}
