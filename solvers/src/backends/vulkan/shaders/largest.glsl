// Largest absolute values over a dispatch: add(i, v) in every invocation, then finish(slot). As bits of f32, which are ordered as
// the numbers are while these are not negative; NaN comes last.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint ROWS = 1; // elements per invocation, a workgroup's width apart

const uint KINDS = 2;
shared uint most[KINDS];
uint own[KINDS] = uint[](0, 0);

void add(uint i, real4 v) {
    uvec4 bits = floatBitsToUint(abs(vec4(v)));
    own[i] = max(own[i], max(max(bits.x, bits.y), max(bits.z, bits.w)));
}

// First element of the invocation.
uint first_element() {
    return group_index() * gl_WorkGroupSize.x * ROWS + gl_LocalInvocationID.x;
}

// Norms, of which kind i of the dispatch goes to place slot + i. All invocations of the workgroup must come here.
#define FINISH(NORMS, SLOT) \
    if (gl_LocalInvocationID.x < KINDS) most[gl_LocalInvocationID.x] = 0; \
    barrier(); \
    [[unroll]] for (uint i = 0; i < KINDS; i++) atomicMax(most[i], own[i]); \
    barrier(); \
    if (gl_LocalInvocationID.x < KINDS) atomicMax(NORMS[SLOT + gl_LocalInvocationID.x], most[gl_LocalInvocationID.x]);
