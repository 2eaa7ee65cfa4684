#version 460
// variants: f64.storage
// r = b - A x, summed in f64 and kept in f32, and the largest of it. Rows are chunks of four entries, the last one padded with
// zeros; rows without any are in no system and stay zero. Per row 8 bytes of indices, b and r; per chunk 48 bytes and four vectors of x, 32 flops.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "largest.glsl"

layout(constant_id = 2) const uint PLANES = 1;
layout(push_constant) uniform Push { uint count; uint slot; };
READ_INDICES(0, starts)
READ_WORDS(1, columns)
READ_VECTORS(2, values)
READ_VECTORS(3, x)
READ_VECTORS(4, b)
layout(std430, binding = 5) writeonly buffer R { vec4 r[]; };
layout(std430, binding = 6) buffer Norms { uint norms[]; };

real4 product(real4 a, uvec4 j, uint plane) {
    return a.x * x_at(PLANES * j.x + plane) + a.y * x_at(PLANES * j.y + plane)
        + a.z * x_at(PLANES * j.z + plane) + a.w * x_at(PLANES * j.w + plane);
}

void main() {
    for (uint k = 0, i = first_element(); k < ROWS; k++, i += gl_WorkGroupSize.x) {
        if (i < count) {
            uint begin = starts_at(i), end = starts_at(i + 1);
            real4 sum0 = real4(0), sum1 = real4(0);
            if (begin < end) {
                sum0 = b_at(PLANES * i);
                if (PLANES == 2) sum1 = b_at(2 * i + 1);
            }
            for (uint chunk = begin; chunk < end; chunk++) {
                uvec4 j = columns_at(chunk);
                real4 a = values_at(chunk);
                sum0 -= product(a, j, 0);
                if (PLANES == 2) sum1 -= product(a, j, 1);
            }
            add(0, sum0);
            r[PLANES * i] = vec4(sum0);
            if (PLANES == 2) {
                add(0, sum1);
                r[2 * i + 1] = vec4(sum1);
            }
        }
    }
    FINISH(norms, slot)
}
