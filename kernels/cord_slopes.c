/* Derivatives of the signals of cords by their points; see optimization/problem/cord_loops.py.
   States are the innermost index. */
#include "cords.h"

/* For each corner of a tet, the nodes on its three edges and the corners at their other ends. */
static const int ON_EDGES[4][3] = {{4, 6, 7}, {4, 5, 8}, {5, 6, 9}, {7, 8, 9}};
static const int BEYOND[4][3] = {{1, 2, 3}, {0, 2, 3}, {1, 0, 3}, {0, 1, 2}};

/* Fill the derivatives (p, 3 s) of the lines' signals by the deformed points: the weighted unit vector of
   the segment that ends at a point, minus that of the next one. The weights are the line's `weights`
   (m, s) and, if any, the segment's derivatives bent[0]. One more row of `pulls` is scratch. */
HOT static void fill_pulls(const int64_t *ends, int64_t lines, const Lines *of, int64_t states,
                           const double *weights, double *RESTRICT pulls)
{
    size_t row = (size_t)(3 * states) * sizeof(double);
    memset(pulls + 3 * states * ends[lines], 0, row);
    for (int64_t c = 0; c < lines; c++) {
        const double *w = weights + states * c;
        memset(pulls + 3 * states * ends[c], 0, row);
        for (int64_t p = ends[c] + 1; p < ends[c + 1]; p++) {
            const double *step = of->steps + states * p;
            const double *to = of->moved + 3 * states * p, *from = to - 3 * states;
            double *RESTRICT out = pulls + 3 * states * p;
            for (int64_t s = 0; s < states; s++)
                out[s] = w[s] / step[s];
            for (int64_t i = 2; i >= 0; i--) /* the factors are in the first row until the end */
                for (int64_t s = 0; s < states; s++)
                    out[states * i + s] = out[s] * (to[states * i + s] - from[states * i + s]);
            for (int64_t i = 0; of->bent && i < 3; i++)
                for (int64_t s = 0; s < states; s++)
                    out[states * i + s] *= of->bent[states * p + s];
        }
    }
    for (int64_t k = 0; k < 3 * states * ends[lines]; k++)
        pulls[k] -= pulls[k + 3 * states];
}

/* Add a multiple of x (s) to y. */
static inline void add_multiple(double factor, const double *RESTRICT x, int64_t states,
                                double *RESTRICT y)
{
    for (int64_t s = 0; s < states; s++)
        y[s] += factor * x[s];
}

/* Derivatives (p, 3, s) of each line's signals by its points, without the part by the rest lengths.
   `by_corner` (4 s) is scratch. */
HOT static void slopes_of_moves(const Lines *of, int64_t points, const int64_t *cells,
                                const double *by_bary, const double *nodal, int64_t states,
                                const double *pulls, double *RESTRICT by_corner,
                                double *RESTRICT out)
{
    int64_t width = 3 * states;
    for (int64_t p = 0; p < points; p++) {
        int64_t e = of->cell[p];
        const int64_t *n = cells + 10 * e;
        const double *v = pulls + width * p;
        for (int i = 0; i < 4; i++) {
            const double *b = of->bary + 4 * p;
            double w0 = 4 * b[i] - 1, w1 = 4 * b[BEYOND[i][0]];
            double w2 = 4 * b[BEYOND[i][1]], w3 = 4 * b[BEYOND[i][2]];
            const double *x0 = nodal + width * n[i], *x1 = nodal + width * n[ON_EDGES[i][0]];
            const double *x2 = nodal + width * n[ON_EDGES[i][1]];
            const double *x3 = nodal + width * n[ON_EDGES[i][2]];
            double *RESTRICT corner = by_corner + states * i;
            for (int64_t s = 0; s < states; s++) {
                int64_t t = states + s, u = 2 * states + s;
                double x = w0 * x0[s] + w1 * x1[s] + w2 * x2[s] + w3 * x3[s];
                double y = w0 * x0[t] + w1 * x1[t] + w2 * x2[t] + w3 * x3[t];
                double z = w0 * x0[u] + w1 * x1[u] + w2 * x2[u] + w3 * x3[u];
                corner[s] = v[s] * x + v[t] * y + v[u] * z;
            }
        }
        for (int i = 0; i < 3; i++) {
            const double *g = by_bary + 12 * e + i;
            double *RESTRICT row = out + width * p + states * i;
            for (int64_t s = 0; s < states; s++)
                row[s] = g[0] * by_corner[s] + g[3] * by_corner[states + s] +
                         g[6] * by_corner[2 * states + s] + g[9] * by_corner[3 * states + s];
        }
    }
}

int run_fill_slopes(const Arg *a)
{
    const double *points = a[0].data;
    const int64_t *ends = a[1].data;
    Lines of = read_lines(a + 5);
    double *out = a[5 + LINES_ARGS].data;
    int64_t count = a[0].size[0], lines = a[1].size[0] - 1, states = a[8].size[1];
    double *scratch = calloc((size_t)((lines + 3 * (count + 1) + 4) * states + 1), sizeof(double));
    if (!scratch)
        return OUT_OF_MEMORY;
    double *weights = scratch, *by_corner = weights + lines * states;
    double *pulls = by_corner + 4 * states;
    for (int64_t c = 0; c < lines; c++)
        memcpy(weights + states * c, of.signals + states * (3 * c + 1),
               (size_t)states * sizeof(double));
    fill_pulls(ends, lines, &of, states, weights, pulls);
    slopes_of_moves(&of, count, a[2].data, a[3].data, a[4].data, states, pulls, by_corner, out);
    for (int64_t c = 0; c < lines; c++) {
        const double *by_rest = of.signals + states * (3 * c + 2), *w = weights + states * c;
        for (int64_t p = ends[c] + 1; p < ends[c + 1]; p++) {
            double inverse = 1 / segment_length(points, p);
            for (int64_t i = 0; i < 3; i++) {
                double step = inverse * (points[3 * p + i] - points[3 * (p - 1) + i]);
                double *after = out + states * (3 * p + i), *before = after - 3 * states;
                if (of.conduction) {
                    const double *b = of.bent + states * p, *by = b + states * count;
                    double turn = of.conduction[4 * p + 1 + i];
                    for (int64_t s = 0; s < states; s++) {
                        double stretch = inverse * of.steps[states * p + s];
                        double x = turn * (by_rest[s] + w[s] * by[s]) - step * w[s] * stretch * b[s];
                        after[s] += x;
                        before[s] -= x;
                    }
                    continue;
                }
                add_multiple(step, by_rest, states, after);
                add_multiple(-step, by_rest, states, before);
                if (of.bent) {
                    const double *b = of.bent + states * (count + p);
                    for (int64_t s = 0; s < states; s++) {
                        after[s] += step * w[s] * b[s];
                        before[s] -= step * w[s] * b[s];
                    }
                }
            }
        }
    }
    free(scratch);
    return DONE;
}

/* Fill h (10), the products of v (width) with the rows of the tet's nodes. Each is summed in four
   parts, which fit a vector of the processor. */
HOT static void products(const double *RESTRICT v, int64_t width, const int64_t *RESTRICT nodes,
                         const double *RESTRICT nodal, double *RESTRICT h)
{
    for (int n = 0; n < 10; n++) {
        const double *x = nodal + width * nodes[n];
        double a = 0.0, b = 0.0, c = 0.0, d = 0.0;
        int64_t k = 0;
        for (; k + 4 <= width; k += 4) {
            a += v[k] * x[k];
            b += v[k + 1] * x[k + 1];
            c += v[k + 2] * x[k + 2];
            d += v[k + 3] * x[k + 3];
        }
        for (; k < width; k++)
            a += v[k] * x[k];
        h[n] = (a + b) + (c + d);
    }
}

/* Derivatives (p, 3) of fill_slopes times `by_signals` (s, m). */
int run_pull_signals(const Arg *a)
{
    const double *points = a[0].data, *by_bary = a[3].data, *nodal = a[4].data;
    const int64_t *ends = a[1].data, *cells = a[2].data;
    const double *by_signals = a[5].data;
    Lines of = read_lines(a + 6);
    double *out = a[6 + LINES_ARGS].data, h[10];
    int64_t count = a[0].size[0], lines = a[1].size[0] - 1, states = a[9].size[1];
    double *weights = calloc((size_t)((lines + 3 * (count + 1)) * states + 1), sizeof(double));
    if (!weights)
        return OUT_OF_MEMORY;
    double *pulls = weights + lines * states;
    for (int64_t c = 0; c < lines; c++)
        for (int64_t s = 0; s < states; s++)
            weights[states * c + s] =
                by_signals[lines * s + c] * of.signals[states * (3 * c + 1) + s];
    fill_pulls(ends, lines, &of, states, weights, pulls);
    for (int64_t p = 0; p < count; p++) {
        const double *b = of.bary + 4 * p, *by = by_bary + 12 * of.cell[p];
        products(pulls + 3 * states * p, 3 * states, cells + 10 * of.cell[p], nodal, h);
        double *sum = out + 3 * p;
        sum[0] = sum[1] = sum[2] = 0.0;
        for (int i = 0; i < 4; i++) {
            double x = (4 * b[i] - 1) * h[i];
            for (int j = 0; j < 3; j++)
                x += 4 * b[BEYOND[i][j]] * h[ON_EDGES[i][j]];
            for (int d = 0; d < 3; d++)
                sum[d] += x * by[3 * i + d];
        }
    }
    for (int64_t c = 0; c < lines; c++) {
        const double *by_rest = of.signals + states * (3 * c + 2), *w = weights + states * c;
        double rest = 0.0;
        for (int64_t s = 0; s < states; s++)
            rest -= by_signals[lines * s + c] * by_rest[s];
        for (int64_t p = ends[c] + 1; p < ends[c + 1]; p++) {
            double own = rest, turn = rest;
            if (of.conduction) {
                own = 0.0;
                for (int64_t s = 0; s < states; s++) {
                    turn -= w[s] * of.bent[states * (count + p) + s];
                    own += w[s] * of.bent[states * p + s] * of.steps[states * p + s];
                }
                own /= segment_length(points, p);
            } else if (of.bent)
                for (int64_t s = 0; s < states; s++)
                    own -= w[s] * of.bent[states * (count + p) + s];
            double inverse = own / segment_length(points, p);
            for (int d = 0; d < 3; d++) {
                double step = inverse * (points[3 * p + d] - points[3 * (p - 1) + d]);
                if (of.conduction)
                    step += turn * of.conduction[4 * p + 1 + d];
                out[3 * p + d] -= step;
                out[3 * (p - 1) + d] += step;
            }
        }
    }
    free(weights);
    return DONE;
}
