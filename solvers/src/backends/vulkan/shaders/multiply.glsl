// Products of a tile with vectors: eight lanes with ROWS rows each, four columns of the right-hand side per vector.
//
// MULTIPLY(at, columns, VECTOR) adds tile[row][k] * VECTOR(k, plane), summed over k, to acc[row of the lane] (and to
// acc[4 + row] for the second plane of four columns). The tile's texels start at `at`, which is moved behind them. All
// lanes read the same vectors; several rows per lane share that.
//
// Per column and lane: 16 / PACK bytes of the tile and 8 flops per row and plane, one vector per plane.

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const uint PLANES = 1;
layout(constant_id = 2) const uint ROWS = 1;

const uint LANES = 8;
const uint MOST_ROWS = 4;

real4 acc[2 * MOST_ROWS];

void clear() {
    [[unroll]] for (uint i = 0; i < 2 * MOST_ROWS; i++) acc[i] = real4(0);
}

#if PACK == 2
#define LOAD(V, K, VECTOR, PLANE) real4 V##0 = VECTOR(K, PLANE), V##1 = VECTOR(K + 1, PLANE)
#define ADD(I, A, V) acc[I] += A.x * V##0; acc[I] += A.y * V##1
#else
#define LOAD(V, K, VECTOR, PLANE) real4 V##0 = VECTOR(K, PLANE), V##1 = VECTOR(K + 1, PLANE), \
    V##2 = VECTOR(K + 2, PLANE), V##3 = VECTOR(K + 3, PLANE)
#define ADD(I, A, V) acc[I] += A.x * V##0; acc[I] += A.y * V##1; acc[I] += A.z * V##2; acc[I] += A.w * V##3
#endif

#define MULTIPLY(AT, COLUMNS, VECTOR) \
    for (uint k = 0; k < COLUMNS; k += PACK) { \
        LOAD(v, k, VECTOR, 0); \
        if (PLANES == 2) { \
            LOAD(w, k, VECTOR, 1); \
            [[unroll]] for (uint r = 0; r < MOST_ROWS; r++) { \
                if (r < ROWS) { \
                    texel a = values_at(AT); \
                    AT += LANES; \
                    ADD(r, a, v); \
                    ADD(MOST_ROWS + r, a, w); \
                } \
            } \
        } else { \
            [[unroll]] for (uint r = 0; r < MOST_ROWS; r++) { \
                if (r < ROWS) { \
                    texel a = values_at(AT); \
                    AT += LANES; \
                    ADD(r, a, v); \
                } \
            } \
        } \
    }
