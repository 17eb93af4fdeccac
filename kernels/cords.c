/* Cords in all states, and their signals; see optimization/problem/cord_loops.py.
   States are the innermost index. */
#include "cords.h"

#define LEVEL_SLOPE 0.1      /* below, a trace is printed in steps of less than a layer over its width */

/* How cords sense; see cord_signals.py. */
typedef struct {
    int64_t is_local;
    double hidden, series, contact_square;
    const double *breaks, *origins, *pieces;
    int64_t count;         /* of breaks */
    const double *section; /* of printed traces, see TraceSection.values; null for cords */
} Answer;
enum { ANSWER_ARGS = 8 };

static Answer read_answer(const Arg *a)
{
    Answer answer = {a[0].count, a[1].number, a[2].number, a[3].number,
                     a[4].data,  a[5].data,   a[6].data,   a[4].size[0],
                     a[7].size[0] ? a[7].data : NULL};
    return answer;
}

/* Return w and fill dw/deps at one strain. */
static inline double respond(double strain, const Answer *r, double *slope)
{
    int64_t i = 0;
    while (i < r->count && strain > r->breaks[i])
        i++;
    const double *c = r->pieces + 4 * i;
    double t = strain - r->origins[i];
    *slope = c[1] + t * (2 * c[2] + t * 3 * c[3]);
    return c[0] + t * (c[1] + t * (c[2] + t * c[3]));
}

int run_evaluate_response(const Arg *a)
{
    const double *strain = a[0].data;
    double *out = a[4].data;
    int64_t count = a[0].size[0];
    Answer r = {0, 0, 0, 0, a[1].data, a[2].data, a[3].data, a[1].size[0], NULL};
    for (int64_t k = 0; k < count; k++)
        out[k] = respond(strain[k], &r, out + count + k);
    return DONE;
}

/* Fill deformed positions (p, width) of points in the tets `cell` (p). */
HOT static void move_points(const int64_t *cell, const double *bary, int64_t points,
                            const int64_t *cells, const double *nodal, int64_t width,
                            double *RESTRICT moved)
{
    for (int64_t p = 0; p < points; p++) {
        const int64_t *n = cells + 10 * cell[p];
        double a = bary[4 * p], b = bary[4 * p + 1], c = bary[4 * p + 2], d = bary[4 * p + 3];
        double w0 = a * (2 * a - 1), w1 = b * (2 * b - 1), w2 = c * (2 * c - 1);
        double w3 = d * (2 * d - 1), w4 = 4 * a * b, w5 = 4 * b * c, w6 = 4 * a * c;
        double w7 = 4 * a * d, w8 = 4 * b * d, w9 = 4 * c * d;
        const double *x0 = nodal + width * n[0], *x1 = nodal + width * n[1];
        const double *x2 = nodal + width * n[2], *x3 = nodal + width * n[3];
        const double *x4 = nodal + width * n[4], *x5 = nodal + width * n[5];
        const double *x6 = nodal + width * n[6], *x7 = nodal + width * n[7];
        const double *x8 = nodal + width * n[8], *x9 = nodal + width * n[9];
        double *RESTRICT out = moved + width * p;
        for (int64_t k = 0; k < width; k++)
            out[k] = w0 * x0[k] + w1 * x1[k] + w2 * x2[k] + w3 * x3[k] + w4 * x4[k] +
                     w5 * x5[k] + w6 * x6[k] + w7 * x7[k] + w8 * x8[k] + w9 * x9[k];
    }
}

int run_move_points(const Arg *a)
{
    move_points(a[0].data, a[1].data, a[0].size[0], a[2].data, a[3].data, a[3].size[1],
                a[4].data);
    return DONE;
}

/* Return the length of level trace that conducts like a segment of a printed trace, and fill its
   derivatives (3) by the segment's end. A segment that rises by `rise` over a level distance `level`
   has the length l, the area height * level / l + pi/4 width * rise / l, and the resistivity
   (level^2 + between_layers * rise^2) / l^2 along it. A rise counts less below LEVEL_SLOPE, so that
   derivatives are continuous where a path is level. */
static double conducting_length(const double *step, const double *section, double *by_step)
{
    const double *up = section;
    double between_layers = section[3], widening = section[4];
    double height = step[0] * up[0] + step[1] * up[1] + step[2] * up[2], across[3], level = 0.0;
    for (int d = 0; d < 3; d++) {
        across[d] = step[d] - height * up[d];
        level += across[d] * across[d];
    }
    level = sqrt(level);
    double bend = LEVEL_SLOPE * level, size = sqrt(height * height + bend * bend) + MIN_LENGTH_MM;
    double sine = height / size, rise = height * sine;
    double area = level + widening * rise + MIN_LENGTH_MM;
    double length = (level * level + between_layers * rise * rise) / area;
    double by_level = (2 * level - length) / area;
    double by_rise = (2 * between_layers * rise - widening * length) / area;
    double by_height = by_rise * sine * (2 - sine * sine);
    by_level -= by_rise * LEVEL_SLOPE * sine * sine * bend / size;
    for (int d = 0; d < 3; d++)
        by_step[d] = by_height * up[d] + by_level * across[d] / (level + MIN_LENGTH_MM);
    return length;
}

/* Fill rows (p, 4): for the segment that ends at a point its resistance per length, as a multiple of
   that of a level trace, and the derivatives of its conducting length by the segment's end. */
static void fill_conduction(const double *points, int64_t first, int64_t last,
                            const double *section, double *conduction)
{
    memset(conduction + 4 * first, 0, 4 * sizeof(double));
    for (int64_t p = first + 1; p < last; p++) {
        double *row = conduction + 4 * p, step[3];
        for (int d = 0; d < 3; d++)
            step[d] = points[3 * p + d] - points[3 * (p - 1) + d];
        row[0] = conducting_length(step, section, row + 1) / segment_length(points, p);
    }
}

int run_fill_conduction(const Arg *a)
{
    fill_conduction(a[0].data, 0, a[0].size[0], a[1].data, a[2].data);
    return DONE;
}

/* Fill the strained share of each segment: the part at least `hidden` mm from both line ends. Return
   the rest length of the strained part; fill the end points of the segments in which it starts and ends. */
static double find_strained(const double *points, int64_t first, int64_t last, double hidden,
                            double *shares, int64_t *start, int64_t *ends)
{
    double total = 0.0, along = 0.0;
    *start = first, *ends = last;
    for (int64_t p = first + 1; p < last; p++)
        total += segment_length(points, p);
    for (int64_t p = first + 1; p < last; p++) {
        double step = segment_length(points, p);
        double low = MAX(along, hidden), high = MIN(along + step, total - hidden);
        shares[p] = hidden > 0 ? MAX(high - low, 0.0) / step : 1.0;
        if (along <= hidden && hidden < along + step)
            *start = p;
        if (along < total - hidden && total - hidden <= along + step)
            *ends = p;
        along += step;
    }
    return MAX(total - 2 * hidden, MIN_LENGTH_MM);
}

/* Fill deformed segment lengths `steps` (p, s) and strained lengths (s) of a line. A segment is stored
   at its end point. */
HOT static void measure(const double *moved, int64_t first, int64_t last, int64_t states,
                        const double *shares, double *RESTRICT steps, double *RESTRICT lengths)
{
    memset(lengths, 0, (size_t)states * sizeof(double));
    for (int64_t p = first + 1; p < last; p++) {
        const double *to = moved + 3 * states * p, *from = to - 3 * states;
        double *RESTRICT step = steps + states * p;
        for (int64_t s = 0; s < states; s++) {
            double x = to[s] - from[s];
            double y = to[states + s] - from[states + s];
            double z = to[2 * states + s] - from[2 * states + s];
            step[s] = sqrt(x * x + y * y + z * z) + MIN_LENGTH_MM;
        }
        for (int64_t s = 0; s < states; s++)
            lengths[s] += shares[p] * step[s];
    }
}

/* A longer segment before the strained part moves the start of that part along its segment. Adds this
   to the derivatives by the rest lengths of the segments from `low` on and before `high`. */
static void add_ends(const double *points, const Answer *answer, const double *steps,
                     const double *shares, int64_t states, int64_t at, int64_t low, int64_t high,
                     double *by_rest)
{
    double own = segment_length(points, at), slope;
    for (int64_t s = 0; s < states; s++) {
        double dense = steps[states * at + s] / own;
        if (answer->is_local)
            dense = 1 + respond(dense - 1, answer, &slope);
        for (int64_t p = low; p < high; p++)
            by_rest[states * p + s] += dense;
        by_rest[states * at + s] += dense * (1 - shares[at]);
    }
}

/* Fill `out` (3, s) with a line's signals and their derivatives by deformed and rest length, both of
   the strained part. For a local response the deformed length is the sum of L (1 + w) over the
   segments, as if they were stretched by w instead of their strain. `bent` (2, p, s), unless null,
   receives the derivatives of the strained length by the deformed and the rest lengths of the segments
   that end at each point. All lengths of a printed trace are those of a level trace that conducts
   alike: `conduction` (p, 4) receives what `fill_conduction` computes, and bent[1] the derivatives by the
   conducting lengths of segments whose strain stays; both are for traces only. `lengths` (s) and `shares`
   (p) are scratch. */
static void fill_signal(const double *points, int64_t count, const double *moved, int64_t first,
                        int64_t last, const Answer *answer, int64_t states, double *steps,
                        double *shares, double *lengths, double *out, double *bent,
                        double *conduction)
{
    double *by_rest = bent ? bent + count * states : NULL;
    int64_t start, ends;
    double rest = find_strained(points, first, last, answer->hidden, shares, &start, &ends);
    if (answer->section) { /* a trace has no hidden part */
        fill_conduction(points, first, last, answer->section, conduction);
        rest = MIN_LENGTH_MM;
        for (int64_t p = first + 1; p < last; p++) {
            shares[p] = conduction[4 * p];
            rest += shares[p] * segment_length(points, p);
        }
    }
    measure(moved, first, last, states, shares, steps, lengths);
    if (answer->is_local)
        memset(lengths, 0, (size_t)states * sizeof(double));
    for (int64_t p = first + 1; p < last; p++) {
        if (answer->is_local) {
            double own = segment_length(points, p);
            for (int64_t s = 0; s < states; s++) {
                double stretch = steps[states * p + s] / own, slope;
                double w = respond(stretch - 1, answer, &slope);
                lengths[s] += shares[p] * own * (1 + w);
                if (bent) {
                    bent[states * p + s] = shares[p] * slope;
                    by_rest[states * p + s] = shares[p] * (1 + w - stretch * slope);
                }
            }
        } else if (bent)
            for (int64_t s = 0; s < states; s++) {
                bent[states * p + s] = shares[p];
                by_rest[states * p + s] = 0.0;
            }
    }
    if (bent && answer->section)
        for (int64_t p = first + 1; p < last; p++) {
            double own = segment_length(points, p), slope;
            for (int64_t s = 0; s < states; s++) {
                double stretch = steps[states * p + s] / own;
                by_rest[states * p + s] =
                    answer->is_local ? 1 + respond(stretch - 1, answer, &slope) : stretch;
            }
        }
    else if (bent && answer->hidden > 0 && start < ends) {
        add_ends(points, answer, steps, shares, states, start, first + 1, start, by_rest);
        add_ends(points, answer, steps, shares, states, ends, ends + 1, last, by_rest);
    }
    double span = rest + answer->series;
    double whole = sqrt(span * span + answer->contact_square);
    double dilution = 1 - rest * span / (whole * whole);
    for (int64_t s = 0; s < states; s++) {
        double w = lengths[s] / rest - 1, slope = 1.0;
        if (!answer->is_local)
            w = respond(w, answer, &slope);
        out[s] = w * rest / whole;
        out[states + s] = slope / whole;
        out[2 * states + s] = (w * dilution - slope * lengths[s] / rest) / whole;
    }
}

/* Signals of paths (c, p, 3). */
int run_fill_signals(const Arg *a)
{
    const double *paths = a[0].data;
    Grid grid = read_grid(a + 1);
    const int64_t *across = a[8].data, *cells = a[9].data;
    const double *nodal = a[11].data;
    Answer answer = read_answer(a + 12);
    double *out = a[12 + ANSWER_ARGS].data;
    int64_t count = a[0].size[1], states = a[12 + ANSWER_ARGS].size[1];
    int64_t *cell = malloc((size_t)(count + 1) * sizeof(int64_t));
    double *scratch = malloc((size_t)(9 * count + 4 * (count + 1) * states) * sizeof(double));
    int status = cell && scratch ? DONE : OUT_OF_MEMORY;
    if (status == DONE) {
        double *bary = scratch, *conduction = bary + 4 * count;
        double *shares = conduction + 4 * count, *moved = shares + count;
        double *steps = moved + 3 * states * count, *lengths = steps + states * count;
        double *signals = lengths + states;
        for (int64_t c = 0; c < a[0].size[0]; c++) {
            const double *path = paths + 3 * count * c;
            locate_path(path, count, &grid, across, cell, bary);
            move_points(cell, bary, count, cells, nodal, 3 * states, moved);
            fill_signal(path, count, moved, 0, count, &answer, states, steps, shares, lengths,
                        signals, NULL, conduction);
            memcpy(out + states * c, signals, (size_t)states * sizeof(double));
        }
    }
    free(scratch);
    free(cell);
    return status;
}

int run_carry_lines(const Arg *a)
{
    const double *points = a[0].data;
    const int64_t *ends = a[1].data;
    Grid grid = read_grid(a + 2);
    Answer answer = read_answer(a + 13);
    Lines lines = read_lines(a + 13 + ANSWER_ARGS);
    int64_t count = a[0].size[0], states = a[13 + ANSWER_ARGS + 3].size[1];
    double *lengths = malloc((size_t)(states + count + 1) * sizeof(double));
    if (!lengths)
        return OUT_OF_MEMORY;
    locate_path(points, count, &grid, a[9].data, lines.cell, lines.bary);
    move_points(lines.cell, lines.bary, count, a[10].data, a[12].data, 3 * states, lines.moved);
    for (int64_t c = 0; c < a[1].size[0] - 1; c++)
        fill_signal(points, count, lines.moved, ends[c], ends[c + 1], &answer, states,
                    lines.steps, lengths + states, lengths, lines.signals + 3 * states * c,
                    lines.bent, lines.conduction);
    free(lengths);
    return DONE;
}
