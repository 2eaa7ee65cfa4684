#version 460
// variants: f64.storage
// x += d, or x = d, of a step d in f32; the largest of d, and of x. Per vector 48 bytes read and 32 written, 4 flops.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "largest.glsl"

layout(push_constant) uniform Push { uint count; uint slot; uint begins; };
READ_FLOATS(0, d)
layout(std430, binding = 1) buffer X { real4 x[]; };
layout(std430, binding = 2) buffer Norms { uint norms[]; };

void main() {
    for (uint k = 0, i = first_element(); k < ROWS; k++, i += gl_WorkGroupSize.x) {
        if (i < count) {
            real4 d = real4(d_at(i)), sum = d;
            if (begins == 0) sum += x[i];
            add(0, d);
            add(1, sum);
            x[i] = sum;
        }
    }
    FINISH(norms, slot)
}
