#version 460
// variants: f32.storage f64.storage
// Rows of four columns to their places, to[index[i]] = from[i], or from them, to[i] = from[index[i]]. Per row an index, one vector
// read and one written.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint BACK = 0;
layout(push_constant) uniform Push { uint count; };
READ_INDICES(0, indices)
READ_VECTORS(1, from)
layout(std430, binding = 2) writeonly buffer To { real4 to[]; };

void main() {
    uint i = group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (i >= count) return;
    uint at = indices_at(i);
    if (BACK == 1) to[i] = from_at(at); else to[at] = from_at(i);
}
