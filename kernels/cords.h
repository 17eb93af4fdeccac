/* Declarations that the loops over cords share. */
#ifndef DEFSENSE_CORDS_H
#define DEFSENSE_CORDS_H

#include "kernels.h"

#define MIN_LENGTH_MM 1e-300 /* added to lengths: coincident points have zero derivatives */

/* Lines in all states, as carry_lines fills them; see Lines. */
typedef struct {
    int64_t *cell;
    double *bary, *moved, *steps, *signals, *bent, *conduction;
} Lines;

enum { LINES_ARGS = 7 };

static inline Lines read_lines(const Arg *a)
{
    Lines lines = {a[0].data, a[1].data, a[2].data, a[3].data, a[4].data,
                   a[5].size[1] ? a[5].data : NULL, a[6].size[0] ? a[6].data : NULL};
    return lines;
}

/* Return the distance of point p from the previous point. */
static inline double segment_length(const double *points, int64_t p)
{
    const double *a = points + 3 * (p - 1), *b = points + 3 * p;
    double x = b[0] - a[0], y = b[1] - a[1], z = b[2] - a[2];
    return sqrt(x * x + y * y + z * z) + MIN_LENGTH_MM;
}

#endif
