"""Linear algebra in one thread, whose sums do not depend on how many cores there are."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Within it the BLAS libraries that are loaded use one thread: with several, results differ in
    their last digits, and a search can end elsewhere. Matrices here are too small to gain from
    more: training took four times as long on two cores. As a decorator, within the function."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, "blas"):
        yield
