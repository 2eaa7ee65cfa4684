#version 460
// variants: f32.storage f64.storage
// Unit quaternions (w, x, y, z) from a field, an invocation per vertex. Where the field vanishes the vertex takes the
// rotation of the mark whose centroid is nearest, the first of equally near ones, and is counted; a vertex of no triangle gets
// zero. Reads and writes one vector; where the field vanishes, two per mark and two indices besides.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const float LEAST = 0; // norm below which a mean says nothing
layout(push_constant) uniform Push { uint count; uint marks; uint first; }; // first: where rotations begin
READ_VECTORS(0, field)
READ_INDICES(1, starts)
READ_VECTORS(2, positions)
READ_VECTORS(3, centroids)
READ_VECTORS(4, rotations)
layout(std430, binding = 5) writeonly buffer Q { real4 q[]; };
layout(std430, binding = 6) buffer Replaced { uint replaced; };

void main() {
    uint v = group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    if (v >= count) return;
    real4 u = field_at(v);
    real squared = dot(u, u);
    if (squared >= real(LEAST) * real(LEAST)) {
        q[v] = u / sqrt(squared);
        return;
    }
    if (starts_at(v) == starts_at(v + 1)) {
        q[v] = real4(0);
        return;
    }
    real4 x = positions_at(v);
    real4 way = x - centroids_at(0);
    real least = dot(way, way);
    uint nearest = 0;
    for (uint m = 1; m < marks; m++) {
        way = x - centroids_at(m);
        real distance = dot(way, way);
        if (distance < least) {
            least = distance;
            nearest = m;
        }
    }
    q[v] = rotations_at(first + nearest);
    atomicAdd(replaced, 1);
}
