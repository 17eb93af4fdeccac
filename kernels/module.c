/* The extension module: checks arguments against each kernel's specification, and calls it without
   the interpreter's lock.

   A specification lists the arguments, separated by spaces; tuples count as their items.
     d i l b   array of float64, int32, int64 or bool, C-contiguous; in capitals if it is written to.
               After a colon follow the lengths of its axes, separated by commas: a number, a letter
               that stands for the same number everywhere, `3s` or `p+1` for what follows from a
               letter, `?p` for p or 0, `*` for any.
     s S       array of float64 whose rows may lie apart
     x k t     float, integer and truth value; `k:m` is an integer from 0 to m */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "kernels.h"

enum { MAX_ARGS = 32 };

#define PLACED "d:p,r d:p,e d:3,3 d:t,3,3 d:2,3"
#define GRID "d:3 x l:3 l:* l:* d:e,3 d:e,4,3"
#define TETS "l:e,10 d:e,4,3 d:n,3s"
#define ANSWER "t x x x d:b d:b+1 d:b+1,4 d:?5v"
#define LINES "l:p d:p,4 d:p,3s d:p,s d:m,3,s d:2,?p,s d:?p,4"

/* Name, specification and first line of help of each kernel. */
#define KERNELS(X)                                                                                 \
    X(energy_density, "k d:5 d:3,3 D:1", "Fill the energy density of one gradient.")               \
    X(stress, "k d:5 d:3,3 D:3,3", "Fill the stress of one gradient.")                             \
    X(tangent, "k d:5 d:3,3 x x D:9,9", "Fill the tangent of one gradient.")                       \
    X(symmetric_eigen, "D:3,3 D:3 D:3,3", "Fill eigenvalues and eigenvectors.")                    \
    X(signed_svd, "d:3,3 D:3,3 D:3 D:3,3", "Fill the factors of a gradient.")                      \
    X(gradients, "d:n,3 l:m,10 d:m,4,10,3 k:m k:m D:m,4,3,3", "Fill deformation gradients.")       \
    X(volume_ratios, "d:m,4,3,3 d:m,4,3,3 k:m k:m D:m,4", "Fill linearized volume ratios.")        \
    X(energies, "d:m,4,3,3 d:m k d:5 k:m k:m D:m", "Fill the energies of tets.")                   \
    X(forces, "d:m,4,3,3 d:m,4,10,3 d:m k d:5 k:m k:m D:m,10,3", "Fill nodal forces of tets.")     \
    X(scatter, "l:m,10 d:m,10,3 D:n,3", "Add nodal values of tets to those of the nodes.")         \
    X(stiffness, "d:m,4,3,3 d:m,4,10,3 d:m k d:5 x k:m k:m D:m,30,30", "Fill tangents of tets.")   \
    X(linearized_forces, "d:m,4,3,3 d:m,4,3,3 d:m,4,10,3 d:m k d:5 k:m k:m D:m,10,3",              \
      "Fill nodal forces of tets, linearized.")                                                    \
    X(expand_rows, "i:g+1 i:* l:g+1 l:g I:*", "Fill the starts of the rows of unknowns.")          \
    X(expand_columns, "i:g+1 i:* l:g+1 l:g i:* I:*", "Fill the columns of unknowns.")              \
    X(pair_offsets, "l:m,10 i:g+1 i:* l:g I:m,10,10", "Fill offsets of groups in rows.")           \
    X(assemble_tangents,                                                                           \
      "d:k,4,3,3 d:k,4,10,3 d:k d:k,4 k d:5 x l:m,10 b:n l:n,6 l:n l:g+1 l:g i:m,10,10 "           \
      "i:u+1 k:m d:n,3,6 D:*",                                                                     \
      "Add the tangents of tets to the entries of a matrix.")                                      \
    X(interpolate, "l:p,10 d:p,10 d:s,n,3 k:p k:p D:s,p,3", "Fill displacements at points.")       \
    X(interpolate_gradients, "l:m,10 d:m,4,3 l:p d:p,4 d:s,n,3 k:p k:p D:s,p,3,3",                 \
      "Fill displacement gradients at points.")                                                    \
    X(fill_grid, "l:m,3 l:m,3 l:3 L:* L:*", "Count or list the tets in cells of a grid.")          \
    X(find_points, "d:p,3 " GRID " k:p k:p L:p D:p,4", "Locate points in tets.")                   \
    X(locate_along_path, "d:p,3 " GRID " l:e,4 L:p D:p,4", "Locate a path's points in tets.")      \
    X(evaluate_response, "d:p d:b d:b+1 d:b+1,4 D:2,p", "Fill w and dw/deps at strains.")          \
    X(fill_conduction, "d:p,3 d:5 D:p,4", "Fill how segments of printed traces conduct.")          \
    X(move_points, "l:p d:p,4 l:e,10 d:n,w D:p,w", "Fill deformed positions of points.")           \
    X(fill_signals, "d:c,p,3 " GRID " l:e,4 " TETS " " ANSWER " D:c,s",                            \
      "Fill the signals of paths.")                                                                \
    X(carry_lines,                                                                                 \
      "d:p,3 l:m+1 " GRID " l:e,4 " TETS " " ANSWER                                                \
      " L:p D:p,4 D:p,3s D:p,s D:m,3,s D:2,?p,s D:?p,4",                                           \
      "Move lines by all states and fill their signals.")                                          \
    X(fill_slopes, "d:p,3 l:m+1 " TETS " " LINES " D:p,3,s",                                       \
      "Fill the derivatives of lines' signals by their points.")                                   \
    X(pull_signals, "d:p,3 l:m+1 " TETS " d:s,m " LINES " D:p,3",                                  \
      "Fill the derivatives by the points of a function of the signals.")                          \
    X(place_cord, "d:* l:f d:p,r d:e d:2,3 x D:r,e D:3 D:3,3 D:t,3,3 D:p,e D:p,3",                 \
      "Place a cord at parameters.")                                                               \
    X(pull_points, PLACED " d:p,3,s D:*,s", "Add derivatives by points to those by parameters.")   \
    X(add_runs, "d:p,3 d:2 k D:*,3", "Extend a path by straight runs.")                            \
    X(add_path_moves, PLACED " d:p,3 d:2 k l:q d:q,3 S:q,*",                                       \
      "Add derivatives of motions of an extended path's samples.")                                 \
    X(interpolate_depth, "d:i,j,k d:3 x d:p,3 D:p", "Fill depths at points.")                      \
    X(find_exits, "d:i,j,k d:3 x d:c,3 d:c,3 x D:c", "Fill distances to the surface.")             \
    X(self_gaps, "d:c,p,3 x D:c", "Fill distances of paths from themselves.")                      \
    X(nearest_segments, "d:p,3 d:q+1,3 d:* d:* x D:p L:p D:p", "Fill closest points of a line.")   \
    X(explained_squares, "d:k,n,c d:f,c d:f,c,c d:n,r x D:k", "Fill squares explained by maps.")   \
    X(square_gradient, "d:n,c d:f,c d:f,c,c d:n,r x D:1 D:n,c",                                    \
      "Fill the squared error of the best map and its derivative.")                                \
    X(crossing_pairs, "d:n,3 l:m,3 d:*,6 k x L:*,2 L:1", "Fill pairs of crossing triangles.")      \
    X(split_corners, "d:n,3 L:n,n", "Fill the corners of triangles over a loop.")

/* Sizes that letters stand for, by their ASCII code; -1 while they are not known. */
typedef int64_t Sizes[128];

/* The checked arguments of a call. */
typedef struct {
    PyObject *items[MAX_ARGS];
    Py_buffer views[MAX_ARGS];
    Arg args[MAX_ARGS];
    int count, held; /* arguments, and buffers that must be released */
} Call;

/* List the arguments; tuples count as their items. */
static int flatten(Call *call, PyObject *const *items, Py_ssize_t count)
{
    for (Py_ssize_t k = 0; k < count; k++) {
        PyObject *item = items[k];
        if (PyTuple_Check(item)) {
            for (Py_ssize_t n = 0; n < PyTuple_Size(item); n++) {
                PyObject *inner = PyTuple_GetItem(item, n);
                if (flatten(call, &inner, 1))
                    return -1;
            }
        } else if (call->count == MAX_ARGS) {
            PyErr_SetString(PyExc_TypeError, "too many arguments");
            return -1;
        } else
            call->items[call->count++] = item;
    }
    return 0;
}

static int64_t read_number(const char **spec)
{
    int64_t value = 0;
    while (**spec >= '0' && **spec <= '9')
        value = 10 * value + *(*spec)++ - '0';
    return value;
}

/* Return whether a size agrees with the next term of a specification, and move behind the term. */
static int agrees(const char **spec, int64_t size, Sizes sizes)
{
    int optional = **spec == '?', any = **spec == '*';
    *spec += optional || any;
    if (any)
        return 1;
    int64_t factor = read_number(spec), more = 0;
    int letter = **spec;
    if (letter < 'a' || letter > 'z')
        return size == factor;
    ++*spec;
    if (**spec == '+') {
        ++*spec;
        more = read_number(spec);
    }
    factor = factor ? factor : 1;
    if (optional && size == 0)
        return 1;
    if (sizes[letter] < 0 && size >= more && (size - more) % factor == 0)
        sizes[letter] = (size - more) / factor;
    return sizes[letter] >= 0 && size == factor * sizes[letter] + more;
}

/* Return whether the entries are of the kind, by the buffer's format and size of an entry. */
static int has_kind(const Py_buffer *view, int kind)
{
    const char *format = view->format ? view->format : "B";
    if (format[0] == '\0' || format[1] != '\0')
        return 0;
    switch (kind) {
    case 'd':
        return format[0] == 'd';
    case 'b':
        return format[0] == '?';
    default: /* the letters of integers depend on the system */
        return strchr("ilq", format[0]) && view->itemsize == (kind == 'i' ? 4 : 8);
    }
}

/* Check one argument against its specification and fill it; return -1 with an error set. */
static int read_argument(Call *call, int index, const char **spec, Sizes sizes)
{
    PyObject *item = call->items[index];
    Arg *arg = call->args + index;
    const char *start = *spec;
    int code = *(*spec)++, kind = code | 32, fits = 1;
    if (kind == 'x') {
        arg->number = PyFloat_AsDouble(item);
        return PyErr_Occurred() ? -1 : 0;
    }
    if (kind == 't') {
        arg->count = PyObject_IsTrue(item);
        return arg->count < 0 ? -1 : 0;
    }
    if (kind == 'k') {
        arg->count = PyLong_AsLongLong(item);
        if (arg->count == -1 && PyErr_Occurred())
            return -1;
        if (**spec == ':') {
            int letter = (*spec)[1];
            *spec += 2;
            fits = arg->count >= 0 && (sizes[letter] < 0 || arg->count <= sizes[letter]);
        }
    } else {
        Py_buffer *view = call->views + call->held;
        int apart = kind == 's';
        int flags = PyBUF_FORMAT | (apart ? PyBUF_STRIDES : PyBUF_C_CONTIGUOUS);
        if (PyObject_GetBuffer(item, view, flags | (code < 'a' ? PyBUF_WRITABLE : 0)))
            return -1;
        call->held++;
        fits = view->ndim > 0 && view->ndim <= 4 && has_kind(view, apart ? 'd' : kind);
        arg->data = view->buf;
        for (int axis = 0; fits && axis < view->ndim; axis++) {
            arg->size[axis] = view->shape[axis];
            ++*spec; /* the colon or comma */
            fits = agrees(spec, view->shape[axis], sizes);
            if (fits && axis + 1 < view->ndim)
                fits = **spec == ',';
        }
        fits = fits && (**spec == ' ' || **spec == '\0');
        if (fits && apart) {
            fits = view->ndim == 2 && view->strides[0] % view->itemsize == 0 &&
                   (view->strides[1] == view->itemsize || view->shape[1] < 2);
            arg->stride = view->strides[0] / view->itemsize;
        }
    }
    if (!fits) {
        PyObject *shape = kind == 'k' ? NULL : PyObject_GetAttrString(item, "shape");
        PyErr_Clear();
        PyErr_Format(PyExc_ValueError, "argument %d of shape %R does not match '%.20s' (module.c)",
                     index + 1, shape ? shape : item, start);
        Py_XDECREF(shape);
    }
    return fits ? 0 : -1;
}

static PyObject *run(int (*kernel)(const Arg *), const char *spec, PyObject *const *items,
                     Py_ssize_t count)
{
    Call call;
    Sizes sizes;
    int status = 0, failed;
    call.count = call.held = 0;
    for (int letter = 'a'; letter <= 'z'; letter++)
        sizes[letter] = -1;
    failed = flatten(&call, items, count);
    for (int k = 0; !failed && k < call.count; k++) {
        if (*spec == '\0') {
            PyErr_SetString(PyExc_TypeError, "too many arguments");
            failed = 1;
        } else {
            failed = read_argument(&call, k, &spec, sizes);
            spec += *spec == ' ';
        }
    }
    if (!failed && *spec != '\0') {
        PyErr_Format(PyExc_TypeError, "arguments are missing: %s", spec);
        failed = 1;
    }
    if (!failed) {
        Py_BEGIN_ALLOW_THREADS
        status = kernel(call.args);
        Py_END_ALLOW_THREADS
    }
    for (int k = 0; k < call.held; k++)
        PyBuffer_Release(call.views + k);
    if (failed)
        return NULL;
    if (status == OUT_OF_MEMORY)
        return PyErr_NoMemory();
    Py_RETURN_NONE;
}

#define DEFINE(name, spec, help)                                                                   \
    int run_##name(const Arg *args);                                                               \
    static PyObject *call_##name(PyObject *self, PyObject *const *items, Py_ssize_t count)         \
    {                                                                                              \
        (void)self;                                                                                \
        return run(run_##name, spec, items, count);                                                \
    }
KERNELS(DEFINE)

#define METHOD(name, spec, help) {#name, (PyCFunction)(void (*)(void))call_##name, METH_FASTCALL, help},
static PyMethodDef methods[] = {KERNELS(METHOD){NULL, NULL, 0, NULL}};

static struct PyModuleDef definition = {
    PyModuleDef_HEAD_INIT, "kernels", "Compiled loops over elements, points and cords.", 0, methods,
    NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit_kernels(void)
{
    return PyModule_Create(&definition);
}
