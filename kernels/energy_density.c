/* Energy density, stress and tangent of a deformation gradient F.
   The equations are in mechanics/elements/energy_density.py and material.py. Matrices are row-major. */
#include "kernels.h"

/* Fill C with the cofactor of F, the derivative of det F by F, and return det F. */
double cofactor(const double *F, double *C)
{
    C[0] = F[4] * F[8] - F[5] * F[7];
    C[1] = F[5] * F[6] - F[3] * F[8];
    C[2] = F[3] * F[7] - F[4] * F[6];
    C[3] = F[7] * F[2] - F[8] * F[1];
    C[4] = F[8] * F[0] - F[6] * F[2];
    C[5] = F[6] * F[1] - F[7] * F[0];
    C[6] = F[1] * F[5] - F[2] * F[4];
    C[7] = F[2] * F[3] - F[0] * F[5];
    C[8] = F[0] * F[4] - F[1] * F[3];
    return F[0] * C[0] + F[1] * C[1] + F[2] * C[2];
}

/* Turn the columns p and q of A (3, 3). */
static void turn_columns(double *A, int p, int q, double c, double s)
{
    for (int k = 0; k < 3; k++) {
        double x = A[3 * k + p], y = A[3 * k + q];
        A[3 * k + p] = c * x - s * y;
        A[3 * k + q] = s * x + c * y;
    }
}

/* Eigenvalues w and eigenvectors (columns of the rotation V) of a symmetric A, which is overwritten.
   Cyclic Jacobi rotations: Golub & Van Loan, Matrix Computations, sec. 8.5. */
static void symmetric_eigen(double *A, double *w, double *V)
{
    static const int P[3] = {0, 0, 1}, Q[3] = {1, 2, 2};
    for (int i = 0; i < 9; i++)
        V[i] = i % 4 == 0;
    double scale = fabs(A[0]) + fabs(A[4]) + fabs(A[8]);
    for (int sweep = 0; sweep < 30; sweep++) {
        if (fabs(A[1]) + fabs(A[2]) + fabs(A[5]) <= 1e-15 * scale)
            break;
        for (int n = 0; n < 3; n++) {
            int p = P[n], q = Q[n];
            if (A[3 * p + q] == 0.0)
                continue;
            double theta = (A[4 * q] - A[4 * p]) / (2 * A[3 * p + q]);
            double t = 1 / (fabs(theta) + sqrt(theta * theta + 1));
            if (theta < 0)
                t = -t;
            double c = 1 / sqrt(t * t + 1), s = t * c;
            turn_columns(A, p, q, c, s);
            for (int k = 0; k < 3; k++) {
                double x = A[3 * p + k], y = A[3 * q + k];
                A[3 * p + k] = c * x - s * y;
                A[3 * q + k] = s * x + c * y;
            }
            turn_columns(V, p, q, c, s);
        }
    }
    for (int i = 0; i < 3; i++)
        w[i] = A[4 * i];
}

/* Factor F into U diag(s) V^T with rotations U and V. The singular values decrease; the smallest
   carries the sign of det F. */
static void signed_svd(const double *F, double *U, double *s, double *V)
{
    double A[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            A[3 * i + j] = F[i] * F[j] + F[3 + i] * F[3 + j] + F[6 + i] * F[6 + j];
    symmetric_eigen(A, s, V);
    for (int i = 0; i < 2; i++) /* largest first, V stays a rotation */
        for (int j = 0; j < 2 - i; j++)
            if (s[j] < s[j + 1]) {
                double larger = s[j + 1];
                s[j + 1] = s[j];
                s[j] = larger;
                for (int k = 0; k < 3; k++) {
                    double x = V[3 * k + j];
                    V[3 * k + j] = V[3 * k + j + 1];
                    V[3 * k + j + 1] = -x;
                }
            }
    for (int i = 0; i < 2; i++) {
        for (int k = 0; k < 3; k++)
            U[3 * k + i] = F[3 * k] * V[i] + F[3 * k + 1] * V[3 + i] + F[3 * k + 2] * V[6 + i];
        if (i == 1) {
            double along = U[0] * U[1] + U[3] * U[4] + U[6] * U[7];
            for (int k = 0; k < 3; k++)
                U[3 * k + 1] -= along * U[3 * k];
        }
        s[i] = sqrt(U[i] * U[i] + U[3 + i] * U[3 + i] + U[6 + i] * U[6 + i]);
        for (int k = 0; k < 3; k++)
            U[3 * k + i] /= s[i];
    }
    U[2] = U[3] * U[7] - U[6] * U[4];
    U[5] = U[6] * U[1] - U[0] * U[7];
    U[8] = U[0] * U[4] - U[3] * U[1];
    s[2] = 0.0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            s[2] += U[3 * i + 2] * F[3 * i + j] * V[3 * j + 2];
}

/* Fill d (10) with the energy density W and its derivatives by the invariants, MPa, in the order
   W, W_1, W_2, W_J, W_11, W_12, W_1J, W_22, W_2J, W_JJ. W is infinite where the material is not
   defined. Kind 1 is the stable model, 0 the split one. */
void evaluate_law(int64_t kind, const double *p, double i1, double i2, double J, double *d)
{
    memset(d, 0, 10 * sizeof(double));
    if (kind == 1) {
        double mu = p[0], lame = p[1], alpha = p[2];
        d[0] = 0.5 * mu * (i1 - 3 - log((i1 + 1) / 4)) +
               0.5 * lame * ((J - alpha) * (J - alpha) - (1 - alpha) * (1 - alpha));
        d[1] = 0.5 * mu * (1 - 1 / (i1 + 1));
        d[3] = lame * (J - alpha);
        d[4] = 0.5 * mu / ((i1 + 1) * (i1 + 1));
        d[9] = lame;
        return;
    }
    if (J <= 0) {
        d[0] = HUGE_VAL;
        return;
    }
    double a = pow(J, -2.0 / 3.0);
    double b = a * a;
    double y = a * i1 - 3;
    double u = p[0] + (2 * p[1] + 3 * p[2] * y) * y; /* derivative by I1* */
    double v = 2 * p[1] + 6 * p[2] * y;
    double y_j = -2.0 / 3.0 * a * i1 / J, y_jj = 10.0 / 9.0 * a * i1 / (J * J);
    d[0] = (p[0] + (p[1] + p[2] * y) * y) * y + p[3] * (b * i2 - 3) +
           0.5 * p[4] * (J - 1) * (J - 1);
    d[1] = u * a;
    d[2] = p[3] * b;
    d[3] = u * y_j - 4.0 / 3.0 * p[3] * b * i2 / J + p[4] * (J - 1);
    d[4] = v * a * a;
    d[6] = v * a * y_j - 2.0 / 3.0 * u * a / J;
    d[8] = -4.0 / 3.0 * p[3] * b / J;
    d[9] = v * y_j * y_j + u * y_jj + 28.0 / 9.0 * p[3] * b * i2 / (J * J) + p[4];
}

/* Return J, and fill C = cof F, I1 and I2. I2(F^T F) is the squared norm of the cofactor. */
static double invariants(const double *F, double *C, double *i1, double *i2)
{
    double J = cofactor(F, C);
    *i1 = *i2 = 0.0;
    for (int i = 0; i < 9; i++) {
        *i1 += F[i] * F[i];
        *i2 += C[i] * C[i];
    }
    return J;
}

/* Fill B = I1 F - F F^T F, half of dI2/dF. */
static void half_slope(const double *F, double i1, double *B)
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double s = 0.0;
            for (int k = 0; k < 3; k++)
                for (int m = 0; m < 3; m++)
                    s += F[3 * i + k] * F[3 * m + k] * F[3 * m + j];
            B[3 * i + j] = i1 * F[3 * i + j] - s;
        }
}

/* Return the energy density W(F), MPa. */
double energy_density(int64_t kind, const double *p, const double *F)
{
    double C[9], d[10], i1, i2;
    double J = invariants(F, C, &i1, &i2);
    evaluate_law(kind, p, i1, i2, J, d);
    return d[0];
}

/* Fill P (3, 3) with the stress dW/dF, MPa. */
void stress(int64_t kind, const double *p, const double *F, double *P)
{
    double C[9], B[9] = {0}, d[10], i1, i2;
    double J = invariants(F, C, &i1, &i2);
    evaluate_law(kind, p, i1, i2, J, d);
    if (d[2] != 0.0)
        half_slope(F, i1, B);
    for (int i = 0; i < 9; i++)
        P[i] = 2 * d[1] * F[i] + 2 * d[2] * B[i] + d[3] * C[i];
}

/* Subtract factor m m^T from H (9, 9). */
static inline void subtract_square(double *RESTRICT H, const double *RESTRICT m, double factor)
{
    for (int r = 0; r < 9; r++) {
        double x = factor * m[r];
        for (int c = 0; c < 9; c++)
            H[9 * r + c] -= x * m[c];
    }
}

/* Raise the negative eigenvalues of H (9, 9) by a share of their distance from zero. */
static inline void project(const double *F, double *H, const double *d, double i1, double share)
{
    double U[9], V[9], s[3], m[9], A[9], a1[3], a2[3], a3[3], w[3], Q[9];
    signed_svd(F, U, s, V);
    for (int k = 0; k < 3; k++) { /* twist and flip modes: exact eigenvectors of H */
        int i = (k + 1) % 3, j = (k + 2) % 3;
        for (int sign = 1; sign >= -1; sign -= 2) {
            double value = 2 * d[1] + 2 * d[2] * (s[k] * s[k] + sign * s[i] * s[j]) +
                           sign * d[3] * s[k];
            /* sign +1: antisymmetric pair, (W_i + W_j) / (s_i + s_j); -1: symmetric pair. */
            if (value < 0) {
                for (int r = 0; r < 3; r++)
                    for (int c = 0; c < 3; c++)
                        m[3 * r + c] = U[3 * r + i] * V[3 * c + j] -
                                       sign * U[3 * r + j] * V[3 * c + i];
                subtract_square(H, m, share * 0.5 * value);
            }
        }
    }
    for (int i = 0; i < 3; i++) {
        a1[i] = 2 * s[i];
        a2[i] = 2 * s[i] * (i1 - s[i] * s[i]);
        a3[i] = s[(i + 1) % 3] * s[(i + 2) % 3];
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double x = d[4] * a1[i] * a1[j] + d[5] * (a1[i] * a2[j] + a2[i] * a1[j]) +
                       d[6] * (a1[i] * a3[j] + a3[i] * a1[j]) + d[7] * a2[i] * a2[j] +
                       d[8] * (a2[i] * a3[j] + a3[i] * a2[j]) + d[9] * a3[i] * a3[j];
            if (i == j)
                x += 2 * d[1] + 2 * d[2] * (i1 - s[i] * s[i]);
            else
                x += 4 * d[2] * s[i] * s[j] + d[3] * s[3 - i - j];
            A[3 * i + j] = x;
        }
    symmetric_eigen(A, w, Q);
    for (int k = 0; k < 3; k++)
        if (w[k] < 0) {
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++) {
                    double x = 0.0;
                    for (int i = 0; i < 3; i++)
                        x += Q[3 * i + k] * U[3 * r + i] * V[3 * c + i];
                    m[3 * r + c] = x;
                }
            subtract_square(H, m, share * w[k]);
        }
}

/* Fill H (9, 9) with the tangent d2W/dF2, MPa; row 3 i + j belongs to F_ij. `lag` is the difference
   of the pressure that multiplies d2J/dF2 from the pressure at F, MPa, `share` (0 to 1) that of the
   negative part of H that is removed. */
void tangent(int64_t kind, const double *p, const double *F, double lag, double share,
             double *RESTRICT H)
{
    double C[9], B[9], d[10], i1, i2;
    double J = invariants(F, C, &i1, &i2);
    half_slope(F, i1, B);
    evaluate_law(kind, p, i1, i2, J, d);
    d[3] += lag;
    for (int r = 0; r < 9; r++) {
        double x = 4 * (d[4] * F[r] + d[5] * B[r]) + 2 * d[6] * C[r];
        double y = 4 * (d[5] * F[r] + d[7] * B[r]) + 2 * d[8] * C[r];
        double z = 2 * (d[6] * F[r] + d[8] * B[r]) + d[9] * C[r];
        for (int q = 0; q < 9; q++)
            H[9 * r + q] = x * F[q] + y * B[q] + z * C[q];
    }
    for (int r = 0; r < 9; r++)
        H[10 * r] += 2 * d[1];
    /* d2J/dF2: each entry of the cofactor is a difference of two products. */
    for (int i = 0; i < 3; i++) {
        int ia = (i + 1) % 3, ib = (i + 2) % 3;
        for (int j = 0; j < 3; j++) {
            int ja = (j + 1) % 3, jb = (j + 2) % 3;
            double *row = H + 9 * (3 * i + j);
            row[3 * ia + ja] += d[3] * F[3 * ib + jb];
            row[3 * ib + jb] += d[3] * F[3 * ia + ja];
            row[3 * ia + jb] -= d[3] * F[3 * ib + ja];
            row[3 * ib + ja] -= d[3] * F[3 * ia + jb];
        }
    }
    if (d[2] != 0.0) { /* d2I2/dF2 */
        double g[9], h[9];
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                g[3 * i + j] = F[i] * F[j] + F[3 + i] * F[3 + j] + F[6 + i] * F[6 + j];
                h[3 * i + j] = F[3 * i] * F[3 * j] + F[3 * i + 1] * F[3 * j + 1] +
                               F[3 * i + 2] * F[3 * j + 2];
            }
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                for (int k = 0; k < 3; k++)
                    for (int m = 0; m < 3; m++) {
                        double s = 2 * F[3 * i + j] * F[3 * k + m] - F[3 * i + m] * F[3 * k + j];
                        if (i == k) {
                            s -= g[3 * j + m];
                            if (j == m)
                                s += i1;
                        }
                        if (j == m)
                            s -= h[3 * i + k];
                        H[9 * (3 * i + j) + 3 * k + m] += 2 * d[2] * s;
                    }
    }
    if (share > 0)
        project(F, H, d, i1, share);
}

/* Kernels of single gradients. */

int run_energy_density(const Arg *a)
{
    *(double *)a[3].data = energy_density(a[0].count, a[1].data, a[2].data);
    return DONE;
}

int run_stress(const Arg *a)
{
    stress(a[0].count, a[1].data, a[2].data, a[3].data);
    return DONE;
}

int run_tangent(const Arg *a)
{
    tangent(a[0].count, a[1].data, a[2].data, a[3].number, a[4].number, a[5].data);
    return DONE;
}

int run_symmetric_eigen(const Arg *a)
{
    symmetric_eigen(a[0].data, a[1].data, a[2].data);
    return DONE;
}

int run_signed_svd(const Arg *a)
{
    signed_svd(a[0].data, a[1].data, a[2].data, a[3].data);
    return DONE;
}
