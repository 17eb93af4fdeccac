"""What is made of a surface once, and asked for many times: search trees, solids."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Generic, TypeVar

from ...core.mesh import Surface

T = TypeVar("T")


class MadeOnce(Generic[T]):
    """What `make` gives for a surface, kept as long as that surface (by its identity) is; it must
    not keep the surface itself."""

    def __init__(self, make: Callable[[Surface], T]) -> None:
        self._make = make
        self._known: dict[int, tuple[weakref.ref[Surface], T]] = {}

    def __call__(self, surface: Surface) -> T:
        key = id(surface)
        found = self._known.get(key)
        if found is not None and found[0]() is surface:
            return found[1]
        made = self._make(surface)
        gone = weakref.ref(surface, lambda _: self._known.pop(key, None))
        self._known[key] = (gone, made)
        return made
