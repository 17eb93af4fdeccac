"""The points of a study's design: values of all its parameters, one point a run."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from .study_toml import Study

Point = Mapping[str, Any]


def points(study: Study) -> list[Point]:
    """All points, always the same for the same study."""
    keys = [p.key for p in study.parameters]
    if study.design == "latin-hypercube":
        shares = _latin_hypercube(study.count, len(keys), study.seed)
        return [
            {p.key: p.at(float(u)) for p, u in zip(study.parameters, row, strict=True)}
            for row in shares
        ]
    combined = itertools.product if study.design == "grid" else zip
    rows = combined(*(p.values for p in study.parameters))
    return [dict(zip(keys, row, strict=True)) for row in rows]


def _latin_hypercube(count: int, dimensions: int, seed: int) -> np.ndarray[Any, Any]:
    """Shares (count, dimensions) in [0, 1): of each parameter one in every interval of 1/count."""
    from scipy.stats import qmc

    return np.asarray(qmc.LatinHypercube(dimensions, rng=seed).random(count))
