/* Expected error of the best map, with the map eliminated; see decoding/elimination.py. */
#include "kernels.h"

/* Features of c signals, and n states of them with r outputs. */
typedef struct {
    const double *linear, *hessian, *outputs;
    double variance;
    int64_t n, c, f, r;
    int is_nonlinear;
} Problem;

static Problem read_problem(const Arg *a, int64_t n, int64_t c)
{
    Problem problem = {a[0].data, a[1].data, a[2].data, a[3].number, n, c, a[0].size[0],
                       a[2].size[1], 0};
    for (int64_t k = 0; k < problem.f * c * c; k++)
        if (problem.hessian[k] != 0.0)
            problem.is_nonlinear = 1;
    return problem;
}

/* Scratch: centered features phi (n, f), their slopes (n, f, c), the lower Cholesky factor (f, f) of
   the normal matrix, and the right side phi^T outputs divided by it (f, r). */
typedef struct {
    double *phi, *slopes, *factor, *right;
} Fit;

static int allocate_fit(const Problem *of, Fit *fit)
{
    int64_t features = of->n * of->f, size = features * (1 + of->c) + of->f * (of->f + of->r);
    fit->phi = malloc((size_t)(size + 1) * sizeof(double));
    if (!fit->phi)
        return OUT_OF_MEMORY;
    fit->slopes = fit->phi + features;
    fit->factor = fit->slopes + features * of->c;
    fit->right = fit->factor + of->f * of->f;
    return DONE;
}

/* Fill the features, their slopes, and the part of the normal matrix that follows from the noise. */
static void fill_features(const Problem *of, const double *signals, Fit *fit)
{
    int64_t c = of->c, f = of->f;
    for (int64_t i = 0; i < of->n; i++) {
        const double *x = signals + c * i;
        double *slopes = fit->slopes + f * c * i;
        for (int64_t a = 0; a < f; a++) {
            double value = 0.0;
            for (int64_t d = 0; d < c; d++) {
                double linear = of->linear[c * a + d], slope = linear;
                if (of->is_nonlinear)
                    for (int64_t e = 0; e < c; e++)
                        slope += of->hessian[c * (c * a + d) + e] * x[e];
                slopes[c * a + d] = slope;
                value += 0.5 * x[d] * (linear + slope);
            }
            fit->phi[f * i + a] = value;
        }
        for (int64_t a = 0; a < f; a++)
            for (int64_t b = 0; b <= a; b++)
                for (int64_t d = 0; d < c; d++)
                    fit->factor[f * a + b] +=
                        of->variance * slopes[c * a + d] * slopes[c * b + d];
    }
    for (int64_t a = 0; a < f; a++) {
        double mean = 0.0;
        for (int64_t i = 0; i < of->n; i++)
            mean += fit->phi[f * i + a] / (double)of->n;
        for (int64_t i = 0; i < of->n; i++)
            fit->phi[f * i + a] -= mean;
    }
}

/* Return the squares of the outputs that the best map of the signals explains, and fill `fit`. */
static double explain(const Problem *of, const double *signals, Fit *fit)
{
    int64_t f = of->f, r = of->r;
    double *factor = fit->factor, *right = fit->right, explained = 0.0;
    for (int64_t k = 0; k < f * f; k++)
        factor[k] = 0.0;
    for (int64_t k = 0; k < f * r; k++)
        right[k] = 0.0;
    fill_features(of, signals, fit);
    for (int64_t i = 0; i < of->n; i++) {
        const double *RESTRICT phi = fit->phi + f * i;
        const double *RESTRICT outputs = of->outputs + r * i;
        for (int64_t a = 0; a < f; a++) {
            double x = phi[a];
            double *RESTRICT row = factor + f * a, *RESTRICT side = right + r * a;
            for (int64_t b = 0; b <= a; b++)
                row[b] += x * phi[b];
            for (int64_t o = 0; o < r; o++)
                side[o] += x * outputs[o];
        }
    }
    for (int64_t a = 0; a < f; a++) {
        double *row = factor + f * a, *side = right + r * a;
        double size = row[a];
        for (int64_t b = 0; b < a; b++) {
            for (int64_t d = 0; d < b; d++)
                row[b] -= row[d] * factor[f * b + d];
            row[b] /= factor[(f + 1) * b];
        }
        for (int64_t d = 0; d < a; d++)
            row[a] -= row[d] * row[d];
        /* The remainder of a feature that repeats the others is rounding: it explains nothing. */
        row[a] = row[a] > 1e-13 * size ? sqrt(row[a]) : 1e150;
        for (int64_t d = 0; d < a; d++)
            for (int64_t o = 0; o < r; o++)
                side[o] -= row[d] * right[r * d + o];
        for (int64_t o = 0; o < r; o++) {
            side[o] /= row[a];
            explained += side[o] * side[o];
        }
    }
    return explained;
}

/* Squares explained for each of the sets of signals (k, n, c). */
int run_explained_squares(const Arg *a)
{
    const double *sets = a[0].data;
    double *out = a[5].data;
    Problem of = read_problem(a + 1, a[0].size[1], a[0].size[2]);
    Fit fit;
    if (allocate_fit(&of, &fit))
        return OUT_OF_MEMORY;
    for (int64_t k = 0; k < a[0].size[0]; k++)
        out[k] = explain(&of, sets + of.n * of.c * k, &fit);
    free(fit.phi);
    return DONE;
}

/* Solve for the map: beta (f, r) replaces the right side. */
static void solve_map(const Problem *of, const Fit *fit)
{
    int64_t f = of->f, r = of->r;
    for (int64_t a = f - 1; a >= 0; a--)
        for (int64_t o = 0; o < r; o++) {
            double x = fit->right[r * a + o];
            for (int64_t d = a + 1; d < f; d++)
                x -= fit->factor[f * d + a] * fit->right[r * d + o];
            fit->right[r * a + o] = x / fit->factor[(f + 1) * a];
        }
}

/* The squared error of one set of signals (n, c) but for a constant, and its derivative. */
int run_square_gradient(const Arg *a)
{
    const double *signals = a[0].data;
    double *square = a[5].data, *out = a[6].data;
    Problem of = read_problem(a + 1, a[0].size[0], a[0].size[1]);
    int64_t c = of.c, f = of.f, r = of.r;
    Fit fit;
    double *by_slope = calloc((size_t)(f * f + f + 1), sizeof(double));
    if (!by_slope)
        return OUT_OF_MEMORY;
    if (allocate_fit(&of, &fit)) {
        free(by_slope);
        return OUT_OF_MEMORY;
    }
    double *by_phi = by_slope + f * f;
    const double *beta = fit.right;
    *square = -explain(&of, signals, &fit);
    solve_map(&of, &fit);
    for (int64_t i = 0; i < f; i++)
        for (int64_t b = 0; b < f; b++)
            for (int64_t o = 0; o < r; o++)
                by_slope[f * i + b] += of.variance * beta[r * i + o] * beta[r * b + o];
    for (int64_t i = 0; i < of.n; i++) {
        const double *slopes = fit.slopes + f * c * i, *phi = fit.phi + f * i;
        double *row = out + c * i;
        memset(by_phi, 0, (size_t)f * sizeof(double));
        memset(row, 0, (size_t)c * sizeof(double));
        for (int64_t o = 0; o < r; o++) {
            double output = of.outputs[r * i + o], residual = -output;
            for (int64_t b = 0; b < f; b++)
                residual += phi[b] * beta[r * b + o];
            /* Residuals sum to zero over the states, so the centering of phi has no effect. */
            for (int64_t b = 0; b < f; b++)
                by_phi[b] += residual * beta[r * b + o];
            *square += output * output;
        }
        for (int64_t b = 0; b < f; b++)
            for (int64_t d = 0; d < c; d++)
                row[d] += 2 * by_phi[b] * slopes[c * b + d];
        if (of.is_nonlinear)
            for (int64_t b = 0; b < f; b++)
                for (int64_t d = 0; d < c; d++) {
                    double w = 0.0;
                    for (int64_t e = 0; e < f; e++)
                        w += by_slope[f * b + e] * slopes[c * e + d];
                    for (int64_t e = 0; e < c; e++)
                        row[e] += 2 * w * of.hessian[c * (c * b + d) + e];
                }
    }
    free(fit.phi);
    free(by_slope);
    return DONE;
}
