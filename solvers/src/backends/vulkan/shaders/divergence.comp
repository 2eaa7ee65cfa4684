#version 460
// variants: f32.storage f64.storage
// Differential coordinates of the fragments, an invocation per vertex: U = sum over its corners of R c, c their weighted edges,
// R c = c + w (u x c) + u x (u x c) with the turn (w, u) of the corner's triangle. Per vertex 8 bytes of indices and a vector
// written; per corner an index, two vectors and 30 flops.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(push_constant) uniform Push { uint count; };
READ_INDICES(0, starts)
READ_INDICES(1, triangles)
READ_VECTORS(2, edges)
READ_VECTORS(3, turns)
layout(std430, binding = 4) writeonly buffer U { real4 u[]; };

void main() {
    uint v = group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (v >= count) return;
    real3 sum = real3(0);
    uint end = starts_at(v + 1);
    for (uint corner = starts_at(v); corner < end; corner++) {
        real3 c = edges_at(corner).xyz;
        real4 turn = turns_at(triangles_at(corner));
        real3 s = cross(turn.yzw, c);
        sum += c + (turn.x * s + cross(turn.yzw, s));
    }
    u[v] = real4(sum, 0);
}
