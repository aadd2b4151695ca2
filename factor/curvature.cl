/* The normal matrix A = sum_d g h h^T of each point, and the best row of a factor that it leads to.
 *
 * A's lower triangle lies in corners of TILE x TILE accumulators:
 *
 *     corner 0 | corner 1  corner 2 | corner 3 ...       corner (high, low) of terms high * TILE + i, low * TILE + k
 *
 * Entries within `near` of the centre, where kernels are steep, are summed one by one. The others are summed over cells
 * of CELL x CELL points: with P_b the sum of h h^T over cell b, the points of cell a have
 *
 *     A_far = sum_b W(a, b) P_b,    W(a, b) = the mean of g over the pairs of their points, 0 for near pairs
 *
 * which is smooth, is interpolated between cells, and costs next to nothing. As neighbours may differ much in reach, W is
 * made of kernels divided by their mass, the sum of their far part; the step of F multiplies A_far by the point's mass,
 * that of H each point's part of P. A only shapes the step; the gradient is exact, so the minimum is too. */

#include "layout.cl"

#ifndef TERMS
#define TERMS 12
#endif
#ifndef TILE
#define TILE 3 /* side of the corners */
#endif
#define TILES   ((TERMS + TILE - 1) / TILE)
#define CORNERS (TILES * (TILES + 1) / 2)
#define CORNER  (TILE * TILE)
#define PAIRS   (CORNERS * CORNER)
#define CELL    4
#define WIDE    ((TERMS + 3) / 4 * 4)

/* As struct cells in curvature.h. */
struct cells {
    int columns, rows; /* of cells */
    int reach;         /* furthest cell of a window */
    int blocks;        /* of LANES cells in a row */
    int stride, pad;   /* of a row of cells, as of a row of points */
    int wide;          /* floats of one row of A_far, a value for each point */
};

/* A's entry (s, t). */
INLINE int entry_of(int s, int t)
{
    int high = max(s / TILE, t / TILE), low = min(s / TILE, t / TILE);
    int row = s / TILE >= t / TILE ? s % TILE : t % TILE;
    int column = s / TILE >= t / TILE ? t % TILE : s % TILE;
    return ((high * (high + 1) / 2 + low) * TILE + row) * TILE + column;
}

/* The cells whose centres a point lies between, and how near it is to the second. */
struct between {
    int low, high;
    float share;
};

INLINE struct between between_cells(int x, int count)
{
    const int low = (x + CELL / 2) / CELL - 1;
    const float share = ((x + CELL / 2) % CELL + 0.5f) / CELL;
    return (struct between){max(low, 0), min(low + 1, count - 1), share};
}

/* pooled[row][pair][stride]: sums over each cell of h h^T, or (outgoing) of f f^T times the point's mass. One work-item:
 * a row of cells and a corner. */
kernel void pool(global const float *factor, global const float *masses, global float *pooled,
                 const int outgoing, const struct cells c, const struct sizes s)
{
    const int cell_y = get_global_id(0), corner = get_global_id(1);
    int high = 0, low = corner;
    while (low > high) {
        low -= ++high;
    }
    const int end = min(s.height, (cell_y + 1) * CELL);
    for (int i = 0; i < TILE; i++) {
        for (int k = 0; k < TILE; k++) {
            global float *to =
                pooled + (size_t)(cell_y * PAIRS + (corner * TILE + i) * TILE + k) * c.stride +
                c.pad;
            for (int x = 0; x < c.columns; x++) {
                float4 sum = 0;
                for (int y = cell_y * CELL; y < end; y++) {
                    global const float *row =
                        factor + (size_t)y * s.planes * s.stride + s.pad + x * CELL;
                    float4 product = vload4(0, row + (high * TILE + i) * s.stride) *
                                     vload4(0, row + (low * TILE + k) * s.stride);
                    sum += outgoing ? product * vload4(x, masses + (size_t)y * s.blocks * LANES)
                                    : product;
                }
                to[x] = sum.s0 + sum.s1 + (sum.s2 + sum.s3);
            }
        }
    }
}

/* far[row][pair][wide]: A_far at each point's x and at the cells' rows. One work-item: a row of cells and a corner.
 * `weights`: [row][offset y][offset x][stride], W(cell, cell + offset); `gathered`: [row][pair][cells]. */
kernel void gather_far(global const float *weights, global const float *pooled,
                       global float *gathered, global float *far, const int outgoing,
                       const struct cells c)
{
    const int cell_y = get_global_id(0), first = get_global_id(1) * CORNER;
    const int side = 2 * c.reach + 1, width = c.blocks * LANES;
    global float *cells = gathered + (size_t)(cell_y * PAIRS + first) * width;
    for (int block = 0; block < c.blocks; block++) {
        VEC sum[CORNER];
        UNROLL for (int i = 0; i < CORNER; i++)
        {
            sum[i] = 0;
        }
        for (int v = -c.reach; v <= c.reach; v++) {
            const int y = cell_y + (outgoing ? -v : v);
            if (y < 0 || y >= c.rows) {
                continue;
            }
            global const float *from =
                pooled + (size_t)(y * PAIRS + first) * c.stride + c.pad + block * LANES;
            global const float *w =
                weights + (size_t)((outgoing ? y : cell_y) * side + v + c.reach) * side * c.stride +
                c.pad + block * LANES;
            for (int u = -c.reach; u <= c.reach; u++, w += c.stride) {
                VEC weight = VLOAD(0, w - (outgoing ? u : 0));
                UNROLL for (int i = 0; i < CORNER; i++)
                {
                    sum[i] =
                        fma(weight, VLOAD(0, from + i * c.stride + (outgoing ? -u : u)), sum[i]);
                }
            }
        }
        UNROLL for (int i = 0; i < CORNER; i++)
        {
            *(global VEC *)(cells + i * width + block * LANES) = sum[i];
        }
    }
    for (int x = 0; x < c.columns * CELL; x++) {
        const struct between b = between_cells(x, c.columns);
        for (int i = 0; i < CORNER; i++) {
            far[(size_t)(cell_y * PAIRS + first + i) * c.wide + x] =
                mix(cells[i * width + b.low], cells[i * width + b.high], b.share);
        }
    }
}

/* The far part of a block of row y, or zeros where there is none. */
INLINE void read_far(VEC *curvature, global const float *far, global const float *masses, int y,
                     int block, int used, int outgoing, const struct cells c, const struct sizes s)
{
    VEC mass = 1;
    if (used && !outgoing) {
        mass = *(global const VEC *)(masses + (y * s.blocks + block) * LANES);
    }
    const struct between b = between_cells(y, c.rows);
    global const float *low = far + (long)b.low * PAIRS * c.wide + block * LANES;
    global const float *high = far + (long)b.high * PAIRS * c.wide + block * LANES;
    for (int i = 0; i < PAIRS; i++) {
        curvature[i] = 0;
        if (used) {
            curvature[i] = mass * mix(*(global const VEC *)(low + i * c.wide),
                                      *(global const VEC *)(high + i * c.wide), (VEC)(b.share));
        }
    }
}

/* curvature [pair] += weights [column] h h^T for the columns first ... first + count - 1 of the window. */
INLINE void add_near(VEC *curvature, const VEC *weights, global const float *other, int first,
                     int count, int outgoing, const struct sizes s)
{
    VEC *corner = curvature;
    const int step = outgoing ? -1 : 1,
              start = outgoing ? s.window / 2 - first : first - s.window / 2;
    for (int high = 0; high < TILES; high++) {
        for (int low = 0; low <= high; low++, corner += TILE * TILE) {
            global const float *rows = other + high * TILE * s.stride + start;
            global const float *columns = other + low * TILE * s.stride + start;
            VEC sum[TILE][TILE];
            UNROLL for (int i = 0; i < TILE * TILE; i++)
            {
                sum[i / TILE][i % TILE] = corner[i];
            }
            for (int j = 0; j < count; j++) {
                VEC h[TILE];
                UNROLL for (int i = 0; i < TILE; i++)
                {
                    h[i] = VLOAD(0, columns + i * s.stride + step * j) * weights[j];
                }
                UNROLL for (int i = 0; i < TILE; i++)
                {
                    VEC row = VLOAD(0, rows + i * s.stride + step * j);
                    UNROLL for (int k = 0; k < TILE; k++)
                    {
                        sum[i][k] = fma(row, h[k], sum[i][k]);
                    }
                }
            }
            UNROLL for (int i = 0; i < TILE * TILE; i++)
            {
                corner[i] = sum[i / TILE][i % TILE];
            }
        }
    }
}

/* `sweeps` passes of coordinate descent from f0 with A and b; writes the row of `next`. */
INLINE void solve(const VEC *b, const VEC *curvature, global const float *own, global float *next,
                  int sweeps, IVEC inside, const struct sizes s)
{
    VEC matrix[TERMS][WIDE], inverse[TERMS], least[TERMS], change[WIDE];
    for (int t = 0; t < WIDE; t++) {
        change[t] = 0;
    }
    for (int t = 0; t < TERMS; t++) {
        for (int u = 0; u < WIDE; u++) {
            matrix[t][u] = u < TERMS ? curvature[entry_of(t, u)] : (VEC)(0);
        }
        least[t] = -*(global const VEC *)(own + t * s.stride);
        inverse[t] = select((VEC)(0), 1 / matrix[t][t], matrix[t][t] > (VEC)(FLT_MIN));
    }
    for (int sweep = 0; sweep < sweeps; sweep++) {
        for (int t = 0; t < TERMS; t++) {
            VEC left[4] = {b[t], 0, 0, 0};
            for (int u = 0; u < WIDE; u += 4) {
                UNROLL for (int i = 0; i < 4; i++)
                {
                    left[i] = fma(-matrix[t][u + i], change[u + i], left[i]);
                }
            }
            VEC step = ((left[0] + left[1]) + (left[2] + left[3])) * inverse[t];
            change[t] = fmax(change[t] + step, least[t]);
        }
    }
    for (int t = 0; t < TERMS; t++) {
        *(global VEC *)(next + t * s.stride) = select((VEC)(0), change[t] - least[t], inside);
    }
}
