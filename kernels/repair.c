/* Defects of surfaces; see geometry/bodies/repair/crossings.py and holes.py. */
#include "kernels.h"

/* Return six times the signed volume of a tetrahedron. */
static double volume(const double *a, const double *b, const double *c, const double *d)
{
    double x = d[0] - a[0], y = d[1] - a[1], z = d[2] - a[2];
    double p = b[0] - a[0], q = b[1] - a[1], r = b[2] - a[2];
    double s = c[0] - a[0], t = c[1] - a[1], u = c[2] - a[2];
    return x * (q * u - r * t) + y * (r * s - p * u) + z * (p * t - q * s);
}

/* Return whether the edge of corners s and e goes through the inside of triangle q. */
static int pierces(const double *v, int64_t s, int64_t e, const int64_t *q, double tolerance)
{
    for (int i = 0; i < 3; i++)
        if (s == q[i] || e == q[i])
            return 0;
    const double *from = v + 3 * s, *to = v + 3 * e;
    const double *a = v + 3 * q[0], *b = v + 3 * q[1], *c = v + 3 * q[2];
    double above = volume(a, b, c, from), below = volume(a, b, c, to);
    if (!((above > tolerance && below < -tolerance) || (above < -tolerance && below > tolerance)))
        return 0;
    double x = volume(from, to, a, b), y = volume(from, to, b, c), z = volume(from, to, c, a);
    return (x > tolerance && y > tolerance && z > tolerance) ||
           (x < -tolerance && y < -tolerance && z < -tolerance);
}

/* Fill the bounds (low, then high) of a triangle. */
static void bound(const double *v, const int64_t *f, double *box)
{
    for (int d = 0; d < 3; d++) {
        double a = v[3 * f[0] + d], b = v[3 * f[1] + d], c = v[3 * f[2] + d];
        double low = MIN(a, b), high = MAX(a, b);
        box[d] = MIN(low, c);
        box[3 + d] = MAX(high, c);
    }
}

static int are_apart(const double *a, const double *b)
{
    return a[0] > b[3] || a[3] < b[0] || a[1] > b[4] || a[4] < b[1] || a[2] > b[5] || a[5] < b[2];
}

/* Return whether an edge of one triangle goes through the other; edges at a shared corner cannot. */
static int cross(const double *v, const int64_t *p, const int64_t *q, double tolerance)
{
    double a[6], b[6];
    int shared = 0;
    bound(v, p, a);
    bound(v, q, b);
    if (are_apart(a, b))
        return 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            shared += p[i] == q[j];
    if (shared > 1)
        return 0;
    for (int k = 0; k < 3; k++)
        if (pierces(v, p[k], p[(k + 1) % 3], q, tolerance) ||
            pierces(v, q[k], q[(k + 1) % 3], p, tolerance))
            return 1;
    return 0;
}

/* Fill `pairs` (k, 2) with triangles that cross, and their number, by a tree of boxes (2 leaves, 6)
   whose node i has the children 2 i and 2 i + 1. */
int run_crossing_pairs(const Arg *a)
{
    const double *v = a[0].data, *boxes = a[2].data;
    const int64_t *f = a[1].data;
    int64_t faces = a[1].size[0], leaves = a[2].size[0] / 2, per_leaf = a[3].count;
    double tolerance = a[4].number, box[6];
    int64_t *pairs = a[5].data, *number = a[6].data, stack[128], count = 0;
    for (int64_t i = 0; i < faces; i++) {
        int top = 1;
        bound(v, f + 3 * i, box);
        stack[0] = 1;
        while (top) {
            int64_t node = stack[--top];
            if (are_apart(boxes + 6 * node, box))
                continue;
            if (node < leaves) {
                stack[top++] = 2 * node;
                stack[top++] = 2 * node + 1;
                continue;
            }
            int64_t first = (node - leaves) * per_leaf, last = MIN(first + per_leaf, faces);
            for (int64_t j = MAX(first, i + 1); j < last; j++)
                if (cross(v, f + 3 * i, f + 3 * j, tolerance)) {
                    if (count == a[5].size[0]) {
                        *number = count;
                        return DONE;
                    }
                    pairs[2 * count] = i;
                    pairs[2 * count + 1] = j;
                    count++;
                }
        }
    }
    *number = count;
    return DONE;
}

/* Fill, for each run from i to k of a loop (n, 3), the corner `split` (n, n) of its triangle on i, k,
   for the least total area of triangles. */
int run_split_corners(const Arg *a)
{
    const double *p = a[0].data;
    int64_t n = a[0].size[0], *split = a[1].data;
    double *best = calloc((size_t)(n * n + 1), sizeof(double));
    if (!best)
        return OUT_OF_MEMORY;
    for (int64_t gap = 2; gap < n; gap++)
        for (int64_t i = 0; i < n - gap; i++) {
            int64_t k = i + gap;
            double smallest = HUGE_VAL;
            for (int64_t j = i + 1; j < k; j++) {
                double ax = p[3 * j] - p[3 * i], bx = p[3 * k] - p[3 * i];
                double ay = p[3 * j + 1] - p[3 * i + 1], by = p[3 * k + 1] - p[3 * i + 1];
                double az = p[3 * j + 2] - p[3 * i + 2], bz = p[3 * k + 2] - p[3 * i + 2];
                double x = ay * bz - az * by, y = az * bx - ax * bz, z = ax * by - ay * bx;
                double area = best[n * i + j] + best[n * j + k] + sqrt(x * x + y * y + z * z);
                if (area < smallest) {
                    smallest = area;
                    split[n * i + k] = j;
                }
            }
            best[n * i + k] = smallest;
        }
    free(best);
    return DONE;
}
