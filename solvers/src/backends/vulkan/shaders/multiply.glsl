// Products of a tile with vectors: eight lanes with ROWS rows each, four columns of the right-hand side per vector.
//
// MULTIPLY(at, columns, VECTOR) adds tile[row][k] * VECTOR(k, plane), summed over k, to acc[row of the lane] (and to
// acc[4 + row] for the second plane of four columns). The tile's texels start at `at`, those that come after them at
// AFTER(at, columns). Columns go STEP at a time; WAYS groups of lanes share them, step by step in turn, and sum_ways() adds
// up what they have.
//
// All lanes need the same vectors. With HANDED each reads one of every step and the subgroup hands them round, which needs
// subgroups of whole groups of lanes; otherwise every lane reads all of them.
//
// Per column and lane: 16 / PACK bytes of the tile and 8 flops per row and plane, one vector per plane.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PLANES = 1;
layout(constant_id = 2) const uint ROWS = 1;
layout(constant_id = 3) const uint WAYS = 1; // a power of two; with more than one, ROWS is 1
layout(constant_id = 4) const uint HANDED = 0;

const uint LANES = 8;
const uint STEP = 8;
const uint MOST_ROWS = 4;

uint lane = gl_LocalInvocationID.x % LANES;
uint way = WAYS == 1 ? 0 : gl_LocalInvocationID.x / LANES % WAYS;

// Number of the invocation's tile in the dispatch.
uint tile_index() {
    return (group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x) / (LANES * WAYS);
}

real4 acc[2 * MOST_ROWS];

void clear() {
    [[unroll]] for (uint i = 0; i < 2 * MOST_ROWS; i++) acc[i] = real4(0);
}

// Column c of the step is lane c's.
#if defined(READ_texel)
#define HAND(OWN, C) subgroupShuffle(OWN, C)
#elif defined(READ_shuffle)
#define HAND(OWN, C) subgroupShuffle(OWN, gl_SubgroupInvocationID / LANES * LANES + C)
#else
#define HAND(OWN, C) OWN
#endif

#define AFTER(AT, COLUMNS) (AT + (COLUMNS + STEP - 1) / STEP * (STEP / PACK) * ROWS * LANES)

// Without loops over arrays: drivers unroll those too late to keep them in registers.
#define VECTOR_OF(VECTOR, OWN, C, PLANE) (HANDED == 1 ? HAND(OWN, C) : VECTOR(k + C, PLANE))

#if PACK == 2
#define LOAD(V, VECTOR, OWN, C, PLANE) \
    real4 V##0 = VECTOR_OF(VECTOR, OWN, C, PLANE), V##1 = VECTOR_OF(VECTOR, OWN, C + 1, PLANE)
#define ADD(I, A, V) acc[I] += A.x * V##0; acc[I] += A.y * V##1
#else
#define LOAD(V, VECTOR, OWN, C, PLANE) \
    real4 V##0 = VECTOR_OF(VECTOR, OWN, C, PLANE), V##1 = VECTOR_OF(VECTOR, OWN, C + 1, PLANE), \
          V##2 = VECTOR_OF(VECTOR, OWN, C + 2, PLANE), V##3 = VECTOR_OF(VECTOR, OWN, C + 3, PLANE)
#define ADD(I, A, V) acc[I] += A.x * V##0; acc[I] += A.y * V##1; acc[I] += A.z * V##2; acc[I] += A.w * V##3
#endif

// Columns C to C + PACK of the step.
#define PRODUCTS(VECTOR, C) { \
    LOAD(v, VECTOR, own0, C, 0); \
    if (PLANES == 2) { \
        LOAD(w, VECTOR, own1, C, 1); \
        [[unroll]] for (uint r = 0; r < MOST_ROWS; r++) { \
            if (r < ROWS) { \
                texel a = values_at(from + (C / PACK * ROWS + r) * LANES); \
                ADD(r, a, v); \
                ADD(MOST_ROWS + r, a, w); \
            } \
        } \
    } else { \
        [[unroll]] for (uint r = 0; r < MOST_ROWS; r++) { \
            if (r < ROWS) { \
                texel a = values_at(from + (C / PACK * ROWS + r) * LANES); \
                ADD(r, a, v); \
            } \
        } \
    } \
}

#if PACK == 2
#define STEP_OF(VECTOR) PRODUCTS(VECTOR, 0) PRODUCTS(VECTOR, 2) PRODUCTS(VECTOR, 4) PRODUCTS(VECTOR, 6)
#else
#define STEP_OF(VECTOR) PRODUCTS(VECTOR, 0) PRODUCTS(VECTOR, 4)
#endif

#define MULTIPLY(AT, COLUMNS, VECTOR) \
    for (uint k = STEP * way; k < COLUMNS; k += STEP * WAYS) { \
        uint from = AT + k / PACK * ROWS * LANES; \
        real4 own0 = real4(0), own1 = real4(0); \
        if (HANDED == 1) { \
            own0 = VECTOR(k + lane, 0); \
            if (PLANES == 2) own1 = VECTOR(k + lane, 1); \
        } \
        STEP_OF(VECTOR) \
    }

#ifdef READ_texel
void sum_ways() {}
#else
layout(constant_id = 5) const uint SHARED = 1; // PLANES per invocation where there are several ways
shared real4 shares[SHARED];

// acc of way 0 becomes the sum over all ways, added in a fixed order. All invocations of the workgroup must come here.
void sum_ways() {
    if (WAYS == 1) return;
    uint own = PLANES * gl_LocalInvocationID.x;
    shares[own] = acc[0];
    if (PLANES == 2) shares[own + 1] = acc[MOST_ROWS];
    barrier();
    for (uint apart = WAYS / 2; apart > 0; apart /= 2) {
        if (way < apart) {
            shares[own] += shares[own + PLANES * LANES * apart];
            if (PLANES == 2) shares[own + 1] += shares[own + 1 + PLANES * LANES * apart];
        }
        barrier();
    }
    acc[0] = shares[own];
    if (PLANES == 2) acc[MOST_ROWS] = shares[own + 1];
}
#endif
