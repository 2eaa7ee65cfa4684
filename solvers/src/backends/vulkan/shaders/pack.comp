#version 460
// variants: f32.storage f64.storage
// Right-hand sides as the host has them, `columns` numbers per row, to rows of `width` numbers as the sweeps have them, or back.
// One number per invocation, so that reads and writes of host memory are in order; 2 numbers moved per invocation.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint BACK = 0;
layout(push_constant) uniform Push { uint count; uint columns; uint width; };
layout(std430, binding = 0) readonly buffer From { real from[]; };
layout(std430, binding = 1) writeonly buffer To { real to[]; };

void main() {
    uint i = group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (i >= count) return;
    uint wide = i / columns * width + i % columns;
    if (BACK == 1) to[i] = from[wide]; else to[wide] = from[i];
}
