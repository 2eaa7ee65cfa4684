#version 460
// variants: f32.texel f32.storage f64.texel f64.storage
// The scalars of an iteration, four columns side by side; one workgroup adds up the partial sums. A column that has reached
// its limit, or whose curvature is not positive, is frozen: its alpha and beta are 0 from then on.
// state: 0 rz, 1 rr, 2 limit of rr, 3 alpha, 4 beta, 5 active (1 or 0), 6 iterations, 7 broken (1 or 0)
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint MODE = 0; // 0: start, rz; 1: alpha from p.q; 2: rr; 3: beta from r.z
layout(constant_id = 2) const uint WIDTH = 64; // of the workgroup
layout(push_constant) uniform Push { uint partials; uint slot; };
READ_VECTORS(0, sums)
layout(std430, binding = 1) buffer State { real4 state[]; };
layout(std430, binding = 2) writeonly buffer History { real4 history[]; };

shared real4 tree[WIDTH];

void main() {
    uint lane = gl_LocalInvocationID.x;
    if (gl_WorkGroupID.x + gl_WorkGroupID.y > 0) return;
    real4 sum = real4(0);
    for (uint i = lane; i < partials; i += WIDTH) sum += sums_at(i);
    tree[lane] = sum;
    barrier();
    for (uint half_width = WIDTH / 2; half_width > 0; half_width /= 2) {
        if (lane < half_width) tree[lane] += tree[lane + half_width];
        barrier();
    }
    if (lane > 0) return;
    sum = tree[0];
    real4 live = state[5], broken = state[7];
    if (MODE == 0) state[0] = sum;
    if (MODE == 1) {
        real4 rz = state[0], alpha = real4(0);
        for (int c = 0; c < 4; c++) {
            if (live[c] == 0) continue;
            if (sum[c] > 0 && rz[c] > 0) {
                alpha[c] = rz[c] / sum[c];
            } else {
                live[c] = 0;
                broken[c] = 1;
            }
        }
        state[3] = alpha;
        state[5] = live;
        state[7] = broken;
    }
    if (MODE == 2) {
        real4 limit = state[2];
        state[6] += live;
        for (int c = 0; c < 4; c++) {
            if (!(sum[c] > limit[c])) {
                if (isnan(sum[c])) broken[c] = 1;
                live[c] = 0;
            }
        }
        state[1] = sum;
        state[5] = live;
        state[7] = broken;
        history[slot] = sum;
    }
    if (MODE == 3) {
        real4 rz = state[0], beta = real4(0);
        for (int c = 0; c < 4; c++) {
            if (live[c] != 0) beta[c] = sum[c] / rz[c];
        }
        state[0] = sum;
        state[4] = beta;
    }
}
