/* Integration over quadratic tetrahedra with four quadrature points; see mechanics/elements/tet10.py.
   Kernels work on the tets from `start` on and before `stop`. */
#include "kernels.h"

int run_gradients(const Arg *a)
{
    const double *x = a[0].data, *gradient = a[2].data;
    const int64_t *cells = a[1].data;
    double *out = a[5].data, local[30];
    for (int64_t e = a[3].count; e < a[4].count; e++) {
        for (int n = 0; n < 10; n++)
            memcpy(local + 3 * n, x + 3 * cells[10 * e + n], 3 * sizeof(double));
        for (int q = 0; q < 4; q++) {
            const double *g = gradient + 120 * e + 30 * q;
            double F[9] = {0};
            for (int n = 0; n < 10; n++)
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++)
                        F[3 * i + j] += local[3 * n + i] * g[3 * n + j];
            memcpy(out + 36 * e + 9 * q, F, sizeof F);
        }
    }
    return DONE;
}

int run_volume_ratios(const Arg *a)
{
    const double *G = a[0].data, *F = a[1].data;
    double *out = a[4].data, C[9];
    for (int64_t k = 4 * a[2].count; k < 4 * a[3].count; k++) {
        double ratio = cofactor(G + 9 * k, C);
        for (int i = 0; i < 9; i++)
            ratio += C[i] * (F[9 * k + i] - G[9 * k + i]);
        out[k] = ratio;
    }
    return DONE;
}

int run_energies(const Arg *a)
{
    const double *F = a[0].data, *weight = a[1].data, *p = a[3].data;
    double *out = a[6].data;
    for (int64_t e = a[4].count; e < a[5].count; e++) {
        out[e] = 0.0;
        for (int q = 0; q < 4; q++)
            out[e] += weight[e] * energy_density(a[2].count, p, F + 36 * e + 9 * q);
    }
    return DONE;
}

int run_forces(const Arg *a)
{
    const double *F = a[0].data, *gradient = a[1].data, *weight = a[2].data, *p = a[4].data;
    double *out = a[7].data, P[9];
    for (int64_t e = a[5].count; e < a[6].count; e++) {
        double local[30] = {0};
        for (int q = 0; q < 4; q++) {
            const double *g = gradient + 120 * e + 30 * q;
            stress(a[3].count, p, F + 36 * e + 9 * q, P);
            for (int n = 0; n < 10; n++)
                for (int i = 0; i < 3; i++) {
                    double s = P[3 * i] * g[3 * n];
                    s += P[3 * i + 1] * g[3 * n + 1];
                    s += P[3 * i + 2] * g[3 * n + 2];
                    local[3 * n + i] += weight[e] * s;
                }
        }
        memcpy(out + 30 * e, local, sizeof local);
    }
    return DONE;
}

/* Add the elements' nodal values to those of the nodes. */
int run_scatter(const Arg *a)
{
    const int64_t *cells = a[0].data;
    const double *local = a[1].data;
    double *out = a[2].data;
    for (int64_t k = 0; k < 10 * a[0].size[0]; k++)
        for (int i = 0; i < 3; i++)
            out[3 * cells[k] + i] += local[3 * k + i];
    return DONE;
}

/* Fill K (30, 30) of one tet with F (4, 3, 3) and shape gradients (4, 10, 3). */
void element_tangent(const double *F, const double *gradient, double weight, int64_t kind,
                     const double *p, const double *lag, double share, double *RESTRICT K)
{
    double H[81], T[9][30], columns[3][30];
    memset(K, 0, 900 * sizeof(double));
    for (int q = 0; q < 4; q++) {
        const double *g = gradient + 30 * q;
        tangent(kind, p, F + 9 * q, lag[q], share, H);
        for (int j = 0; j < 3; j++) /* the gradient of the node of each column */
            for (int n = 0; n < 10; n++)
                for (int b = 0; b < 3; b++)
                    columns[j][3 * n + b] = g[3 * n + j];
        for (int r = 0; r < 9; r++) {
            const double *h = H + 9 * r;
            for (int n = 0; n < 10; n++)
                for (int b = 0; b < 3; b++) {
                    int c = 3 * n + b;
                    T[r][c] = weight * (h[3 * b] * columns[0][c] + h[3 * b + 1] * columns[1][c] +
                                        h[3 * b + 2] * columns[2][c]);
                }
        }
        for (int n = 0; n < 10; n++)
            for (int i = 0; i < 3; i++) {
                double g0 = g[3 * n], g1 = g[3 * n + 1], g2 = g[3 * n + 2];
                const double *t0 = T[3 * i], *t1 = T[3 * i + 1], *t2 = T[3 * i + 2];
                double *RESTRICT row = K + 30 * (3 * n + i);
                for (int c = 3 * n; c < 30; c++)
                    row[c] += g0 * t0[c] + g1 * t1[c] + g2 * t2[c];
            }
    }
    for (int r = 3; r < 30; r++)
        for (int c = 0; c < 3 * (r / 3); c++)
            K[30 * r + c] = K[30 * c + r];
}

int run_stiffness(const Arg *a)
{
    static const double none[4] = {0};
    const double *F = a[0].data, *gradient = a[1].data, *weight = a[2].data, *p = a[4].data;
    double *out = a[8].data;
    for (int64_t e = a[6].count; e < a[7].count; e++)
        element_tangent(F + 36 * e, gradient + 120 * e, weight[e], a[3].count, p, none,
                        a[5].number, out + 900 * e);
    return DONE;
}

int run_linearized_forces(const Arg *a)
{
    const double *G = a[0].data, *D = a[1].data, *gradient = a[2].data, *weight = a[3].data;
    const double *p = a[5].data;
    double *out = a[8].data, P[9], H[81];
    for (int64_t e = a[6].count; e < a[7].count; e++) {
        double local[30] = {0};
        for (int q = 0; q < 4; q++) {
            const double *g = gradient + 120 * e + 30 * q, *d = D + 36 * e + 9 * q;
            stress(a[4].count, p, G + 36 * e + 9 * q, P);
            tangent(a[4].count, p, G + 36 * e + 9 * q, 0.0, 1.0, H);
            for (int r = 0; r < 9; r++)
                for (int c = 0; c < 9; c++)
                    P[r] += H[9 * r + c] * d[c];
            for (int n = 0; n < 10; n++)
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++)
                        local[3 * n + i] += weight[e] * P[3 * i + j] * g[3 * n + j];
        }
        memcpy(out + 30 * e, local, sizeof local);
    }
    return DONE;
}
