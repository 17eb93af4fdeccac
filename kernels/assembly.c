/* Assembly of the tangents into a sparse matrix; see mechanics/loading/assembly.py. */
#include "kernels.h"

/* Expand the pattern of groups (upper, diagonal first in a row) to the starts of the unknowns' rows. */
int run_expand_rows(const Arg *a)
{
    const int32_t *indptr = a[0].data, *indices = a[1].data;
    const int64_t *start = a[2].data, *size = a[3].data;
    int32_t *out = a[4].data, sum = 0;
    int64_t groups = a[3].size[0];
    out[0] = 0;
    for (int64_t g = 0; g < groups; g++) {
        int64_t width = 0;
        for (int32_t k = indptr[g]; k < indptr[g + 1]; k++)
            if (indices[k] != g)
                width += size[indices[k]];
        for (int64_t i = 0; i < size[g]; i++) {
            sum += (int32_t)(width + size[g] - i);
            out[start[g] + i + 1] = sum;
        }
    }
    return DONE;
}

/* Fill the columns of the unknowns' rows. */
int run_expand_columns(const Arg *a)
{
    const int32_t *indptr = a[0].data, *indices = a[1].data, *rows = a[4].data;
    const int64_t *start = a[2].data, *size = a[3].data;
    int32_t *columns = a[5].data;
    int64_t groups = a[3].size[0];
    for (int64_t g = 0; g < groups; g++)
        for (int64_t i = 0; i < size[g]; i++) {
            int64_t at = rows[start[g] + i];
            for (int64_t c = start[g] + i; c < start[g] + size[g]; c++)
                columns[at++] = (int32_t)c;
            for (int32_t k = indptr[g]; k < indptr[g + 1]; k++) {
                int64_t h = indices[k];
                if (h != g)
                    for (int64_t c = start[h]; c < start[h] + size[h]; c++)
                        columns[at++] = (int32_t)c;
            }
        }
    return DONE;
}

/* Fill offsets (m, 10, 10) of the second node's group in the rows of the first node's. */
int run_pair_offsets(const Arg *a)
{
    const int64_t *groups = a[0].data, *size = a[3].data;
    const int32_t *indptr = a[1].data, *indices = a[2].data;
    int32_t *out = a[4].data;
    int32_t *before = malloc((size_t)(a[2].size[0] + 1) * sizeof(int32_t));
    if (!before)
        return OUT_OF_MEMORY;
    for (int64_t g = 0; g < a[3].size[0]; g++) {
        int32_t at = 0;
        for (int32_t k = indptr[g]; k < indptr[g + 1]; k++) {
            before[k] = at;
            if (indices[k] != g)
                at += (int32_t)size[indices[k]];
        }
    }
    for (int64_t e = 0; e < a[0].size[0]; e++)
        for (int i = 0; i < 10; i++)
            for (int j = 0; j < 10; j++) {
                int64_t g = groups[10 * e + i], h = groups[10 * e + j];
                int32_t offset = 0;
                if (g >= 0 && h > g) {
                    int32_t low = indptr[g], high = indptr[g + 1];
                    while (high - low > 1) {
                        int32_t middle = (low + high) / 2;
                        if (indices[middle] <= h)
                            low = middle;
                        else
                            high = middle;
                    }
                    offset = before[low];
                }
                out[100 * e + 10 * i + j] = offset;
            }
    free(before);
    return DONE;
}

/* Add a block of K (30, 30), of the tet's nodes i and j, to the rows of a node that has other unknowns
   than its coordinates, or of one coupled with such a node. `shift` is the offset of the second group
   behind the first one's own unknowns, or -1 if both are one group. */
static void add_special(const double *K, int i, int j, const int64_t *of_i, const int64_t *of_j,
                        const double *basis_i, const double *basis_j, const int32_t *rows,
                        int64_t shift, double *data)
{
    double half[3][6], block[6][6];
    for (int r = 0; r < 3; r++)
        for (int d = 0; d < 6; d++) {
            half[r][d] = 0.0;
            if (of_j[d] >= 0)
                for (int s = 0; s < 3; s++)
                    half[r][d] += K[30 * (3 * i + r) + 3 * j + s] * basis_j[6 * s + d];
        }
    for (int c = 0; c < 6; c++) {
        if (of_i[c] < 0)
            continue;
        for (int d = 0; d < 6; d++) {
            block[c][d] = 0.0;
            for (int r = 0; r < 3; r++)
                block[c][d] += basis_i[6 * r + c] * half[r][d];
        }
    }
    for (int c = 0; c < 6; c++) {
        int64_t x = of_i[c];
        if (x < 0)
            continue;
        for (int d = 0; d < 6; d++) {
            int64_t y = of_j[d];
            if (y < 0)
                continue;
            if (shift >= 0)
                data[rows[x] + shift - x + y] += block[c][d];
            else if (y >= x)
                data[rows[x] + y - x] += block[c][d];
        }
    }
}

/* Add the tangents of the tets from number `first` on to the entries `data` of the matrix. The first
   four arguments are those tets' gradients, shape gradients, weights and pressure differences. */
int run_assemble_tangents(const Arg *a)
{
    const double *F = a[0].data, *gradient = a[1].data, *weight = a[2].data, *lag = a[3].data;
    const double *p = a[5].data, *basis = a[16].data;
    const int64_t *cells = a[7].data, *local = a[9].data, *group = a[10].data;
    const int64_t *start = a[11].data, *size = a[12].data;
    const uint8_t *special = a[8].data;
    const int32_t *offset = a[13].data, *indptr = a[14].data;
    double *data = a[17].data, K[900];
    int64_t count = MIN(a[0].size[0], a[7].size[0] - a[15].count);
    for (int64_t k = 0; k < count; k++) {
        int64_t e = a[15].count + k;
        element_tangent(F + 36 * k, gradient + 120 * k, weight[k], a[4].count, p, lag + 4 * k,
                        a[6].number, K);
        for (int i = 0; i < 10; i++) {
            int64_t ni = cells[10 * e + i], g = group[ni];
            if (g < 0)
                continue;
            for (int j = 0; j < 10; j++) {
                int64_t nj = cells[10 * e + j], h = group[nj];
                if (h < g)
                    continue;
                int64_t shift = size[g] + offset[100 * e + 10 * i + j];
                const int32_t *rows = indptr + start[g];
                if (special[ni] || special[nj]) {
                    add_special(K, i, j, local + 6 * ni, local + 6 * nj, basis + 18 * ni,
                                basis + 18 * nj, rows, g == h ? -1 : shift, data);
                    continue;
                }
                for (int r = 0; r < 3; r++) {
                    const double *row = K + 30 * (3 * i + r) + 3 * j;
                    if (g == h)
                        for (int s = r; s < 3; s++)
                            data[rows[r] + s - r] += row[s];
                    else
                        for (int s = 0; s < 3; s++)
                            data[rows[r] + shift - r + s] += row[s];
                }
            }
        }
    }
    return DONE;
}
