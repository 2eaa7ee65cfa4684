#version 460
// variants: f32.storage f64.storage
// The rotation of a triangle: the mean of the unit quaternions of its vertices, sqrt(2) times a unit quaternion; the first one
// where they cancel. Per triangle 16 bytes of indices, three vectors read and one written, 25 flops.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const float LEAST = 0; // norm below which a mean says nothing
layout(push_constant) uniform Push { uint count; };
READ_WORDS(0, triangles)
READ_VECTORS(1, q)
layout(std430, binding = 2) writeonly buffer Turns { real4 turns[]; };

void main() {
    uint t = group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (t >= count) return;
    uvec4 v = triangles_at(t);
    real4 a = q_at(v.x);
    real4 sum = (a + q_at(v.y)) + q_at(v.z);
    real squared = dot(sum, sum);
    if (!(squared >= real(LEAST) * real(LEAST))) {
        sum = a;
        squared = real(1);
    }
    turns[t] = sum * sqrt(real(2) / squared);
}
