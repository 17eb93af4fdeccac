/* Tets that hold points, and values there; see mechanics/elements/point_location.py. */
#include "kernels.h"

static const int EDGES[6][2] = {{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}};

Grid read_grid(const Arg *args)
{
    Grid grid = {args[0].data, args[1].number, args[2].data, args[3].data,
                 args[4].data, args[5].data,   args[6].data};
    return grid;
}

int run_interpolate(const Arg *a)
{
    const int64_t *nodes = a[0].data;
    const double *weights = a[1].data, *fields = a[2].data;
    double *out = a[5].data;
    int64_t points = a[0].size[0], width = 3 * a[2].size[1];
    for (int64_t s = 0; s < a[2].size[0]; s++)
        for (int64_t p = a[3].count; p < a[4].count; p++) {
            double sum[3] = {0};
            for (int n = 0; n < 10; n++)
                for (int i = 0; i < 3; i++)
                    sum[i] += weights[10 * p + n] * fields[width * s + 3 * nodes[10 * p + n] + i];
            memcpy(out + 3 * (points * s + p), sum, sizeof sum);
        }
    return DONE;
}

int run_interpolate_gradients(const Arg *a)
{
    const int64_t *cells = a[0].data, *at = a[2].data;
    const double *by_bary = a[1].data, *bary = a[3].data, *fields = a[4].data;
    double *out = a[7].data, g[30];
    int64_t points = a[2].size[0], width = 3 * a[4].size[1];
    for (int64_t p = a[5].count; p < a[6].count; p++) {
        const int64_t *cell = cells + 10 * at[p];
        const double *by = by_bary + 12 * at[p], *b = bary + 4 * p;
        for (int j = 0; j < 3; j++) {
            for (int n = 0; n < 4; n++)
                g[3 * n + j] = (4 * b[n] - 1) * by[3 * n + j];
            for (int k = 0; k < 6; k++) {
                int n = EDGES[k][0], m = EDGES[k][1];
                g[3 * (4 + k) + j] = 4 * (b[m] * by[3 * n + j] + b[n] * by[3 * m + j]);
            }
        }
        for (int64_t s = 0; s < a[4].size[0]; s++) {
            double sum[9] = {0};
            for (int n = 0; n < 10; n++)
                for (int i = 0; i < 3; i++) {
                    double u = fields[width * s + 3 * cell[n] + i];
                    for (int j = 0; j < 3; j++)
                        sum[3 * i + j] += u * g[3 * n + j];
                }
            memcpy(out + 9 * (points * s + p), sum, sizeof sum);
        }
    }
    return DONE;
}

/* Count the tets of each cell of the grid, from the cells a (m, 3) of their boxes' low corners and
   b (m, 3) of the high ones, or list them once the starts (cells + 1) are summed. */
int run_fill_grid(const Arg *args)
{
    const int64_t *a = args[0].data, *b = args[1].data, *count = args[2].data;
    int64_t *start = args[3].data, *items = args[4].data;
    int64_t cells = args[3].size[0] - 1, *fill = NULL;
    int listing = args[4].size[0] > 0;
    if (listing) {
        fill = malloc((size_t)(cells + 1) * sizeof(int64_t));
        if (!fill)
            return OUT_OF_MEMORY;
        memcpy(fill, start, (size_t)(cells + 1) * sizeof(int64_t));
    }
    for (int64_t e = 0; e < args[0].size[0]; e++)
        for (int64_t i = a[3 * e]; i <= b[3 * e]; i++)
            for (int64_t j = a[3 * e + 1]; j <= b[3 * e + 1]; j++)
                for (int64_t k = a[3 * e + 2]; k <= b[3 * e + 2]; k++) {
                    int64_t c = (i * count[1] + j) * count[2] + k;
                    if (listing)
                        items[fill[c]++] = e;
                    else
                        start[c + 1]++;
                }
    free(fill);
    return DONE;
}

/* Fill the barycentric coordinates (4) in tet e and return the smallest. */
static double weights_in(const double *point, int64_t e, const Grid *grid, double *bary)
{
    const double *origin = grid->origin + 3 * e, *gradient = grid->gradient + 12 * e;
    double x = point[0] - origin[0], y = point[1] - origin[1], z = point[2] - origin[2];
    for (int b = 0; b < 4; b++) {
        double w = b == 0 ? 1.0 : 0.0;
        w += x * gradient[3 * b];
        w += y * gradient[3 * b + 1];
        w += z * gradient[3 * b + 2];
        bary[b] = w;
    }
    double low = MIN(bary[0], bary[1]);
    low = MIN(low, bary[2]);
    return MIN(low, bary[3]);
}

static int64_t clamp(int64_t value, int64_t low, int64_t high)
{
    return value < low ? low : value > high ? high : value;
}

/* Return the tet that holds a point, starting at tet `hint`, and fill its weights (4). */
static int64_t find_point(const double *point, const Grid *grid, int64_t hint, double *bary)
{
    const int64_t *count = grid->count;
    int64_t at[3], low[3], high[3];
    if (weights_in(point, hint, grid, bary) >= 1e-9)
        return hint;
    for (int d = 0; d < 3; d++) {
        double step = floor((point[d] - grid->low[d]) / grid->size);
        at[d] = step >= (double)count[d] ? count[d] - 1 : step > 0 ? (int64_t)step : 0;
    }
    double best = -HUGE_VAL;
    int64_t cell = 0, longest = MAX(count[0], count[1]);
    longest = MAX(longest, count[2]);
    for (int64_t reach = 0; reach < longest; reach++) {
        for (int d = 0; d < 3; d++) {
            low[d] = clamp(at[d] - reach, 0, count[d]);
            high[d] = clamp(at[d] + reach + 1, 0, count[d]);
        }
        for (int64_t i = low[0]; i < high[0]; i++)
            for (int64_t j = low[1]; j < high[1]; j++)
                for (int64_t k = low[2]; k < high[2]; k++) {
                    if (llabs(i - at[0]) != reach && llabs(j - at[1]) != reach &&
                        llabs(k - at[2]) != reach)
                        continue;
                    int64_t c = (i * count[1] + j) * count[2] + k;
                    for (int64_t n = grid->start[c]; n < grid->start[c + 1]; n++) {
                        double m = weights_in(point, grid->items[n], grid, bary);
                        if (m > best) {
                            best = m;
                            cell = grid->items[n];
                        }
                    }
                }
        if (best >= -1e-12 || (best > -HUGE_VAL && reach >= 1))
            break;
    }
    weights_in(point, cell, grid, bary);
    return cell;
}

int run_find_points(const Arg *a)
{
    const double *points = a[0].data;
    Grid grid = read_grid(a + 1);
    int64_t first = a[8].count, *cells = a[10].data;
    double *bary = a[11].data;
    for (int64_t p = first; p < a[9].count; p++)
        cells[p] = find_point(points + 3 * p, &grid, p > first ? cells[p - 1] : 0, bary + 4 * p);
    return DONE;
}

/* Locate the points of a path by walking through faces from one tet to the next. */
void locate_path(const double *points, int64_t count, const Grid *grid, const int64_t *across,
                 int64_t *cells, double *bary)
{
    int64_t at = 0;
    for (int64_t p = 0; p < count; p++) {
        const double *point = points + 3 * p;
        double *b = bary + 4 * p;
        int64_t e = at;
        int inside = 0;
        for (int step = 0; step < 8; step++) {
            const double *origin = grid->origin + 3 * e, *g = grid->gradient + 12 * e;
            double x = point[0] - origin[0], y = point[1] - origin[1], z = point[2] - origin[2];
            int lowest = 0;
            b[0] = 1.0;
            for (int i = 1; i < 4; i++) {
                b[i] = g[3 * i] * x + g[3 * i + 1] * y + g[3 * i + 2] * z;
                b[0] -= b[i];
            }
            for (int i = 1; i < 4; i++)
                if (b[i] < b[lowest])
                    lowest = i;
            inside = b[lowest] >= 0.0;
            if (inside || across[4 * e + lowest] < 0)
                break;
            e = across[4 * e + lowest];
        }
        at = inside ? e : find_point(point, grid, at, b);
        cells[p] = at;
    }
}

int run_locate_along_path(const Arg *a)
{
    Grid grid = read_grid(a + 1);
    locate_path(a[0].data, a[0].size[0], &grid, a[8].data, a[9].data, a[10].data);
    return DONE;
}
