// Products of a tile with vectors: one lane per row, four columns of the right-hand side per vector.
//
// MULTIPLY(at, columns, VECTOR) adds to acc0 (and acc1 for a second plane of four columns) the sum over k of
// tile[lane][k] * VECTOR(k, plane), the tile's texels starting at `at`, which is moved behind them. All lanes need the
// same vectors. On lavapipe every lane of a subgroup of eight fetches one of them and hands it round, which is four
// times as cheap as eight fetches of each; elsewhere all lanes read the same address.
//
// Cost per column and lane: 16 / PACK bytes of the tile, 8 flops per plane.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PLANES = 1;

const uint LANES = 8; // rows of a tile

#ifdef READ_texel
#extension GL_KHR_shader_subgroup_ballot : require
layout(constant_id = 2) const uint HAND_ROUND = 0; // 1 where a subgroup is a tile
#else
const uint HAND_ROUND = 0;
#define subgroupBroadcast(V, J) (V)
#endif

#if PACK == 2
#define ADD(ACC, A, V0, V1, V2, V3) ACC += A.x * V0; ACC += A.y * V1
#else
#define ADD(ACC, A, V0, V1, V2, V3) ACC += A.x * V0; ACC += A.y * V1; ACC += A.z * V2; ACC += A.w * V3
#endif

// PACK columns from J on, their vectors in lanes J, J + 1, ... of m0 and m1.
#if PACK == 2
#define BROADCAST(ACC, A, M, J) ADD(ACC, A, subgroupBroadcast(M, J), subgroupBroadcast(M, J + 1), 0, 0)
#else
#define BROADCAST(ACC, A, M, J) ADD(ACC, A, subgroupBroadcast(M, J), subgroupBroadcast(M, J + 1), \
    subgroupBroadcast(M, J + 2), subgroupBroadcast(M, J + 3))
#endif
#define STEP(AT, J) { \
    texel a = values_at(AT); \
    AT += LANES; \
    BROADCAST(acc0, a, m0, J); \
    if (PLANES == 2) { BROADCAST(acc1, a, m1, J); } \
}
#if PACK == 2
#define FOUR(AT, J) STEP(AT, J) STEP(AT, J + 2)
#else
#define FOUR(AT, J) STEP(AT, J)
#endif

#define MULTIPLY(AT, COLUMNS, VECTOR) \
    if (HAND_ROUND == 1) { \
        uint k = 0; \
        for (; k + 8 <= COLUMNS; k += 8) { \
            real4 m0 = VECTOR(k + lane, 0), m1 = m0; \
            if (PLANES == 2) m1 = VECTOR(k + lane, 1); \
            FOUR(AT, 0) FOUR(AT, 4) \
        } \
        if (k < COLUMNS) { \
            real4 m0 = VECTOR(k + lane, 0), m1 = m0; \
            if (PLANES == 2) m1 = VECTOR(k + lane, 1); \
            FOUR(AT, 0) \
        } \
    } else { \
        for (uint k = 0; k < COLUMNS; k += PACK) { \
            texel a = values_at(AT); \
            AT += LANES; \
            ADD(acc0, a, VECTOR(k, 0), VECTOR(k + 1, 0), VECTOR(k + 2, 0), VECTOR(k + 3, 0)); \
            if (PLANES == 2) { \
                ADD(acc1, a, VECTOR(k, 1), VECTOR(k + 1, 1), VECTOR(k + 2, 1), VECTOR(k + 3, 1)); \
            } \
        } \
    }
