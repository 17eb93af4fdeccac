/* Cords at given parameters, and the limits that they keep; see optimization/problem/cord_kinematics.py
   and depth_grid.py, and optimization/limits. */
#include "kernels.h"

/* Turn axes (3, 3) about their axis k, in place, by the angle of cosine c and sine s. With the
   derivatives of both and rest = 0 the result is the derivative of the axes. */
static void turn(double *axes, int k, double c, double s, double rest)
{
    int i = (k + 1) % 3, j = (k + 2) % 3;
    for (int d = 0; d < 3; d++) {
        double *row = axes + 3 * d;
        double a = row[i], b = row[j];
        row[i] = c * a + s * b;
        row[j] = c * b - s * a;
        row[k] = rest * row[k];
    }
}

int run_place_cord(const Arg *a)
{
    const double *x = a[0].data, *basis = a[2].data, *center = a[3].data, *moves = a[4].data;
    const int64_t *rows = a[1].data;
    double reach = a[5].number, *stack = a[6].data, *pivot = a[7].data, *axes = a[8].data;
    double *turns = a[9].data, *local = a[10].data, *points = a[11].data;
    int64_t free_rows = a[1].size[0], all_rows = a[6].size[0], dims = a[6].size[1];
    int64_t frame = dims * free_rows;
    for (int64_t r = 0; r < free_rows; r++)
        for (int64_t i = 0; i < dims; i++)
            stack[dims * rows[r] + i] += x[dims * r + i];
    if (a[9].size[0]) {
        for (int k = 0; k < 3; k++)
            memcpy(turns + 9 * k, axes, 9 * sizeof(double));
        for (int k = 0; k < 3; k++) {
            double angle = x[frame + 2 + k] / reach, c = cos(angle), s = sin(angle);
            for (int t = 0; t < 3; t++) {
                if (t == k)
                    turn(turns + 9 * t, k, -s / reach, c / reach, 0.0);
                else
                    turn(turns + 9 * t, k, c, s, 1.0);
            }
            turn(axes, k, c, s, 1.0);
            for (int d = 0; d < 3; d++)
                pivot[d] += k == 2 ? 0.0 : x[frame + k] * moves[3 * k + d];
        }
    }
    for (int64_t p = 0; p < a[2].size[0]; p++) {
        double *at = local + dims * p;
        for (int64_t i = 0; i < dims; i++)
            at[i] = -center[i];
        for (int64_t r = 0; r < all_rows; r++) {
            double w = basis[all_rows * p + r];
            if (w != 0.0) /* a point follows the four rows of its span */
                for (int64_t i = 0; i < dims; i++)
                    at[i] += w * stack[dims * r + i];
        }
        for (int d = 0; d < 3; d++) {
            points[3 * p + d] = pivot[d];
            for (int64_t i = 0; i < dims; i++)
                points[3 * p + d] += at[i] * axes[3 * d + i];
        }
    }
    return DONE;
}

/* How samples of a cord follow its parameters; see PlacedCord. */
typedef struct {
    const double *basis, *local, *axes, *turns, *moves;
    int64_t rows, dims, is_turning; /* 2 dimensions in a plane, 3 in space */
} Placed;
enum { PLACED_ARGS = 5 };

static Placed read_placed(const Arg *a)
{
    Placed placed = {a[0].data, a[1].data,    a[2].data,    a[3].data,
                     a[4].data, a[0].size[1], a[1].size[1], a[3].size[0]};
    return placed;
}

/* Add the derivatives by the points (p, 3, s), propagated to the parameters, to `out`. */
HOT static void pull(const Placed *of, const double *by_points, int64_t points, int64_t states,
                     double *RESTRICT turned, double *RESTRICT total, double *RESTRICT moment,
                     double *RESTRICT out)
{
    const double *axes = of->axes;
    int64_t rows = of->rows, dims = of->dims;
    for (int64_t p = 0; p < points; p++) {
        const double *x = by_points + 3 * states * p, *y = x + states, *z = y + states;
        for (int64_t i = 0; i < dims; i++)
            for (int64_t s = 0; s < states; s++)
                turned[states * i + s] =
                    x[s] * axes[i] + y[s] * axes[3 + i] + z[s] * axes[6 + i];
        for (int64_t r = 0; r < rows; r++) {
            double w = of->basis[rows * p + r];
            if (w == 0.0)
                continue;
            double *row = out + dims * states * r;
            for (int64_t k = 0; k < dims * states; k++)
                row[k] += w * turned[k];
        }
        if (!of->is_turning)
            continue;
        for (int64_t k = 0; k < 3 * states; k++)
            total[k] += x[k];
        for (int64_t d = 0; d < 3; d++)
            for (int64_t i = 0; i < 2; i++)
                for (int64_t s = 0; s < states; s++)
                    moment[states * (2 * d + i) + s] += of->local[dims * p + i] * x[states * d + s];
    }
    if (!of->is_turning)
        return;
    out += dims * rows * states;
    for (int64_t d = 0; d < 3; d++)
        for (int64_t s = 0; s < states; s++) {
            for (int64_t m = 0; m < 2; m++)
                out[states * m + s] += of->moves[3 * m + d] * total[states * d + s];
            for (int64_t t = 0; t < 3; t++)
                for (int64_t i = 0; i < 2; i++)
                    out[states * (2 + t) + s] +=
                        of->turns[9 * t + 3 * d + i] * moment[states * (2 * d + i) + s];
        }
}

int run_pull_points(const Arg *a)
{
    Placed of = read_placed(a);
    int64_t states = a[PLACED_ARGS].size[2];
    double *scratch = calloc((size_t)(12 * states + 1), sizeof(double));
    if (!scratch)
        return OUT_OF_MEMORY;
    pull(&of, a[PLACED_ARGS].data, a[0].size[0], states, scratch, scratch + 3 * states,
         scratch + 6 * states, a[PLACED_ARGS + 1].data);
    free(scratch);
    return DONE;
}

/* Add the derivatives of the motion of sample i along a direction (3) to a row. */
static void add_move(const Placed *of, int64_t i, const double *direction, double *row)
{
    int64_t dims = of->dims;
    const double *axes = of->axes, *local = of->local + dims * i, *basis = of->basis + of->rows * i;
    double turned[3];
    for (int64_t k = 0; k < dims; k++)
        turned[k] = direction[0] * axes[k] + direction[1] * axes[3 + k] + direction[2] * axes[6 + k];
    for (int64_t r = 0; r < of->rows; r++) {
        double w = basis[r];
        if (w != 0.0)
            for (int64_t k = 0; k < dims; k++)
                row[dims * r + k] += w * turned[k];
    }
    if (!of->is_turning)
        return;
    row += dims * of->rows;
    for (int d = 0; d < 3; d++) {
        for (int m = 0; m < 2; m++)
            row[m] += direction[d] * of->moves[3 * m + d];
        for (int t = 0; t < 3; t++) {
            const double *by = of->turns + 9 * t + 3 * d;
            row[2 + t] += direction[d] * (by[0] * local[0] + by[1] * local[1]);
        }
    }
}

/* Fill a path (p, 3) with straight runs of `number` samples each before its start and after its end,
   where their length is not zero. */
int run_add_runs(const Arg *a)
{
    const double *path = a[0].data, *runs = a[1].data;
    double *out = a[3].data;
    int64_t count = a[0].size[0], number = a[2].count, before = runs[0] > 0 ? number : 0;
    memcpy(out + 3 * before, path, (size_t)(3 * count) * sizeof(double));
    for (int end = 0; end < 2; end++) {
        if (!(runs[end] > 0))
            continue;
        const double *last = end ? path + 3 * (count - 1) : path;
        const double *inner = end ? last - 3 : last + 3;
        double step[3], square = 0.0;
        for (int d = 0; d < 3; d++) {
            step[d] = last[d] - inner[d];
            square += step[d] * step[d];
        }
        double scale = runs[end] / sqrt(square) / (double)number;
        for (int d = 0; d < 3; d++)
            step[d] *= scale;
        for (int64_t k = 0; k < number; k++) {
            double *at = out + 3 * (end ? before + count + k : before - 1 - k);
            for (int d = 0; d < 3; d++)
                at[d] = last[d] + (double)(k + 1) * step[d];
        }
    }
    return DONE;
}

/* Add the derivatives of the motion of samples (q) of a path with runs along directions (q, 3). A run's
   sample turns with the path's last step. */
int run_add_path_moves(const Arg *a)
{
    Placed of = read_placed(a);
    const double *path = a[5].data, *runs = a[6].data, *directions = a[9].data;
    const int64_t *samples = a[8].data;
    int64_t number = a[7].count, count = a[5].size[0], before = runs[0] > 0 ? number : 0;
    double *out = a[10].data;
    for (int64_t q = 0; q < a[8].size[0]; q++) {
        const double *direction = directions + 3 * q;
        double *row = out + a[10].stride * q;
        int64_t i = samples[q] - before;
        if (i >= 0 && i < count) {
            add_move(&of, i, direction, row);
            continue;
        }
        int64_t last = i < 0 ? 0 : count - 1, inner = i < 0 ? 1 : count - 2;
        double s = i < 0 ? (double)-i * runs[0] / (double)number
                         : (double)(i - count + 1) * runs[1] / (double)number;
        double step[3], along[3], across[3], square = 0.0, dot = 0.0;
        for (int d = 0; d < 3; d++) {
            step[d] = path[3 * last + d] - path[3 * inner + d];
            square += step[d] * step[d];
        }
        double size = sqrt(square);
        for (int d = 0; d < 3; d++) {
            step[d] /= size;
            dot += step[d] * direction[d];
        }
        for (int d = 0; d < 3; d++) {
            double x = (direction[d] - step[d] * dot) * s / size;
            along[d] = direction[d] + x;
            across[d] = -x;
        }
        add_move(&of, last, along, row);
        add_move(&of, inner, across, row);
    }
    return DONE;
}

/* Return the depth at a point of a regular grid, or minus its step outside of it. */
static double depth_at(const double *depth, const int64_t *count, const double *low, double step,
                       double x, double y, double z)
{
    double a = (x - low[0]) / step, b = (y - low[1]) / step, c = (z - low[2]) / step, out = 0.0;
    if (!(a >= 0 && b >= 0 && c >= 0 && a < (double)(count[0] - 1) && b < (double)(count[1] - 1) &&
          c < (double)(count[2] - 1)))
        return -step;
    int64_t i = (int64_t)a, j = (int64_t)b, k = (int64_t)c;
    a -= (double)i;
    b -= (double)j;
    c -= (double)k;
    for (int s = 0; s < 2; s++)
        for (int t = 0; t < 2; t++) {
            const double *at = depth + ((i + s) * count[1] + j + t) * count[2] + k;
            double w = (s ? a : 1 - a) * (t ? b : 1 - b);
            out += w * ((1 - c) * at[0] + c * at[1]);
        }
    return out;
}

int run_interpolate_depth(const Arg *a)
{
    const double *points = a[3].data;
    double *out = a[4].data;
    for (int64_t p = 0; p < a[3].size[0]; p++)
        out[p] = depth_at(a[0].data, a[0].size, a[1].data, a[2].number, points[3 * p],
                          points[3 * p + 1], points[3 * p + 2]);
    return DONE;
}

/* Distances after which rays leave the body, infinite where they exceed the longest. */
int run_find_exits(const Arg *a)
{
    const double *points = a[3].data, *directions = a[4].data;
    double step = a[2].number, longest = a[5].number, stride = step / 2, *out = a[6].data;
    for (int64_t c = 0; c < a[3].size[0]; c++) {
        const double *p = points + 3 * c, *d = directions + 3 * c;
        double s = 0.0;
        double before = depth_at(a[0].data, a[0].size, a[1].data, step, p[0], p[1], p[2]);
        out[c] = HUGE_VAL;
        while (s < longest) {
            s += stride;
            double now = depth_at(a[0].data, a[0].size, a[1].data, step, p[0] + s * d[0],
                                  p[1] + s * d[1], p[2] + s * d[2]);
            if (now <= 0) {
                double at = s - stride * (1 - before / (before - now));
                out[c] = before > 0 ? MAX(at, 0.0) : 0.0;
                break;
            }
            before = now;
        }
    }
    return DONE;
}

static double square_distance(const double *a, const double *b)
{
    double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    return x * x + y * y + z * z;
}

/* Smallest distance (c) of each path (c, p, 3) from its own other strands, infinite without one. */
int run_self_gaps(const Arg *a)
{
    const double *paths = a[0].data;
    double separation = a[1].number, *out = a[2].data;
    int64_t count = a[0].size[1];
    double *along = malloc((size_t)(count + 1) * sizeof(double));
    if (!along)
        return OUT_OF_MEMORY;
    along[0] = 0.0;
    for (int64_t c = 0; c < a[0].size[0]; c++) {
        const double *path = paths + 3 * count * c;
        double longest = 0.0, least = HUGE_VAL;
        for (int64_t p = 1; p < count; p++) {
            double step = sqrt(square_distance(path + 3 * p, path + 3 * (p - 1)));
            longest = MAX(longest, step);
            along[p] = along[p - 1] + step;
        }
        for (int64_t p = 0; p < count; p++)
            for (int64_t q = 0; q < p; q++)
                if (along[p] - along[q] >= separation + longest) {
                    double square = square_distance(path + 3 * p, path + 3 * q);
                    least = MIN(least, square);
                }
        out[c] = sqrt(least);
    }
    free(along);
    return DONE;
}

/* Closest points of a polyline (q, 3): distances, segments and positions on these. With a separation,
   segments whose middle is nearer along the line do not count. */
int run_nearest_segments(const Arg *a)
{
    const double *points = a[0].data, *line = a[1].data, *along = a[2].data, *middle = a[3].data;
    double separation = a[4].number, *distance = a[5].data, *where = a[7].data, longest = 0.0;
    int64_t *segment = a[6].data, segments = a[1].size[0] - 1;
    for (int64_t k = 0; k < segments; k++) {
        double step = sqrt(square_distance(line + 3 * (k + 1), line + 3 * k));
        longest = MAX(longest, step);
    }
    for (int64_t p = 0; p < a[0].size[0]; p++) {
        const double *point = points + 3 * p;
        /* Neighboring points are close to neighboring segments. */
        int64_t start = p > 0 ? segment[p - 1] : 0, nearest = 0;
        double best = HUGE_VAL, position = 0.0;
        for (int64_t n = 0; n <= segments && segments > 0; n++) {
            int64_t k = n == 0 ? start : n - 1;
            if (separation > 0.0 && fabs(along[p] - middle[k]) < separation)
                continue;
            const double *from = line + 3 * k;
            double dot = 0.0, size = 0.0, gap = 0.0;
            for (int d = 0; d < 3; d++) {
                double step = from[3 + d] - from[d], off = point[d] - from[d];
                dot += off * step;
                size += step * step;
                gap += off * off;
            }
            if (gap > (best + longest) * (best + longest))
                continue;
            double t = MAX(size, 1e-30);
            t = dot / t;
            t = MAX(t, 0.0);
            t = MIN(t, 1.0);
            double square = gap - 2 * t * dot + t * t * size;
            if (square < best * best) {
                best = sqrt(MAX(square, 0.0));
                nearest = k;
                position = t;
            }
        }
        distance[p] = best;
        segment[p] = nearest;
        where[p] = position;
    }
    return DONE;
}
