/* Declarations that the compiled loops share. */
#ifndef DEFSENSE_KERNELS_H
#define DEFSENSE_KERNELS_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* MSVC, GCC and clang all have this spelling in C99. */
#define RESTRICT __restrict

/* Hot loops are also compiled for AVX2 where the system can choose at start. Sums are written in a
   fixed order and products are not contracted, so both versions compute the same numbers. */
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__GLIBC__)
#define HOT __attribute__((target_clones("avx2", "default")))
#else
#define HOT
#endif

/* The order of the comparison is Python's: the first of equal values. */
#define MIN(a, b) ((b) < (a) ? (b) : (a))
#define MAX(a, b) ((b) > (a) ? (b) : (a))

/* An argument of a kernel, checked against its specification (module.c). */
typedef struct {
    void *data;
    int64_t size[4]; /* lengths of the axes */
    int64_t stride;  /* entries from one row to the next */
    double number;   /* value of a float */
    int64_t count;   /* value of an integer or bool */
} Arg;

/* Kernels return 0, or -1 if memory ran out. */
enum { DONE = 0, OUT_OF_MEMORY = -1 };

/* energy_density.c */
double cofactor(const double *F, double *C);
void evaluate_law(int64_t kind, const double *p, double i1, double i2, double J, double *d);
double energy_density(int64_t kind, const double *p, const double *F);
void stress(int64_t kind, const double *p, const double *F, double *P);
void tangent(int64_t kind, const double *p, const double *F, double lag, double share, double *H);

/* tet10.c */
void element_tangent(const double *F, const double *gradient, double weight, int64_t kind,
                     const double *p, const double *lag, double share, double *K);

/* point_location.c: a uniform grid over the bounding boxes of tets; see PointLocator. */
typedef struct {
    const double *low;
    double size;
    const int64_t *count, *start, *items;
    const double *origin, *gradient;
} Grid;
enum { GRID_ARGS = 7 };
Grid read_grid(const Arg *args);
void locate_path(const double *points, int64_t count, const Grid *grid, const int64_t *across,
                 int64_t *cells, double *bary);

#endif
