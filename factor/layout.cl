/* How responses, masks and factors lie on the device, and reading vectors of them: what update.cl and hals.cl share.
 *
 * Both factors' steps read the same copy of R, whose layout responses.h draws. For a step of F, lanes are points x_i and
 * R is read aligned. For a step of H ("outgoing"), lanes are points x_o, entry dx was lit at x_o - dx, and a vector of R
 * is blended of two:
 *
 *     block q   at dx: |. . . a b c d e|    x_i = first ... first + LANES-1 straddles two blocks,
 *     block q+1 at dx: |f g h . . . . .|    a b c d e f g h is what the lanes need
 *
 * Factors are planes [y][term][stride] with zeros around each row, so that x needs no tests; behind the last row come
 * rows of zeros for work-items that reach beyond it. */

#ifndef LANES
#define LANES 8 /* points side by side in a vector */
#endif
#ifndef CLUSTERED
#define CLUSTERED 0 /* more than one kernel */
#endif
#ifndef MASKED
#define MASKED 0 /* some entries were not measured */
#endif
#ifndef HALF
#define HALF 0 /* responses are stored as half floats */
#endif
#define JOIN_(a, b) a##b
#define JOIN(a, b)  JOIN_(a, b)
#define VEC         JOIN(float, LANES)
#define IVEC        JOIN(int, LANES)
#define VLOAD       JOIN(vload, LANES)
#define INLINE      static inline __attribute__((always_inline, unused))
#define UNROLL      _Pragma("unroll")

#define VLOAD_ALIGNED(offset, from) (*(global const VEC *)((from) + (offset)*LANES))

/* A stored response, to be read by load_entry alone. */
#if HALF
typedef half stored;
#define LOAD         JOIN(vload_half, LANES)
#define LOAD_ALIGNED JOIN(vloada_half, LANES)
#else
typedef float stored;
#define LOAD         VLOAD
#define LOAD_ALIGNED VLOAD_ALIGNED
#endif

#if LANES == 4
#define LOG_LANES    2
#define LANE_NUMBERS (int4)(0, 1, 2, 3)
#define LANE_BITS    (int4)(1, 2, 4, 8)
#elif LANES == 8
#define LOG_LANES    3
#define LANE_NUMBERS (int8)(0, 1, 2, 3, 4, 5, 6, 7)
#define LANE_BITS    (int8)(1, 2, 4, 8, 16, 32, 64, 128)
#else
#define LOG_LANES    4
#define LANE_NUMBERS (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
#define LANE_BITS                                                                                  \
    (int16)(1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768)
#endif

/* As struct layout_sizes in layout.h. */
struct sizes {
    int width, height, window, terms;
    int planes;       /* of a factor: terms and zeros */
    int blocks;       /* of LANES points in a row */
    int stride;       /* floats of one row of one plane of a factor */
    int pad;          /* zeros before each row of it */
    int row;          /* floats of a row (y, dy) of responses */
    int lead;         /* floats before the first */
    int label_stride; /* labels of a row of points, the pad before it included */
};

/* A vector of `row`, which has the layout of a row (y, dy): entry `e` (= dx + half) of the LANES points of a block, or
 * (outgoing) of the points that lie at distance dx before the block's. */
#define LOAD_ROW(NAME, TYPE, ALIGNED, UNALIGNED)                                                   \
    INLINE VEC NAME(global const TYPE *row, int window, int block, int e, int outgoing)            \
    {                                                                                              \
        if (!outgoing) {                                                                           \
            return ALIGNED(0, row + (block * window + e) * LANES);                                 \
        }                                                                                          \
        int first = block * LANES + window / 2 - e;                                                \
        int from = first >> LOG_LANES, shift = first & (LANES - 1);                                \
        global const TYPE *near = row + (from * window + e) * LANES + shift;                       \
        VEC low = UNALIGNED(0, near), high = UNALIGNED(0, near + window * LANES - LANES);          \
        return select(high, low, (IVEC)(LANES - shift) > LANE_NUMBERS);                            \
    }

/* Of responses, and of anything else in their layout that is made of floats. */
LOAD_ROW(load_entry, stored, LOAD_ALIGNED, LOAD)
LOAD_ROW(load_floats, float, VLOAD_ALIGNED, VLOAD)

/* Which of those were measured: lanes of -1 or 0. */
INLINE IVEC load_mask(global const ushort *row, int window, int block, int e, int outgoing)
{
    int bits;
    if (!outgoing) {
        bits = row[block * window + e];
    } else {
        int first = block * LANES + window / 2 - e;
        int from = first >> LOG_LANES, shift = first & (LANES - 1);
        global const ushort *near = row + from * window + e;
        bits = (near[0] >> shift) | (near[window] << (LANES - shift));
    }
    return ((IVEC)(bits)&LANE_BITS) != 0;
}
