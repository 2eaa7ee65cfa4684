#version 460
// variants: f64.storage
// A right-hand side in f32 for the first pair of sweeps, and the largest of it. Per vector 32 bytes read and 16 written.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "largest.glsl"

layout(push_constant) uniform Push { uint count; uint slot; };
READ_VECTORS(0, b)
layout(std430, binding = 1) writeonly buffer R { vec4 r[]; };
layout(std430, binding = 2) buffer Norms { uint norms[]; };

void main() {
    for (uint k = 0, i = first_element(); k < ROWS; k++, i += gl_WorkGroupSize.x) {
        if (i < count) {
            real4 v = b_at(i);
            add(0, v);
            r[i] = vec4(v);
        }
    }
    FINISH(norms, slot)
}
