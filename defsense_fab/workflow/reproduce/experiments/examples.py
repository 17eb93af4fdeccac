"""Experiments by name: examples of the package, and folders of users."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path

from ....core.errors import ExperimentError
from ....core.storage.package_data import package_data
from .experiment import Experiment
from .experiment_file import FILE, load_experiment

LAST_FIGURE = 99  # sorts experiments without a figure to the end


def example_names() -> tuple[str, ...]:
    """Return the names of the package's examples, in the order of the paper's figures."""
    folders = [f for f in _examples_folder().iterdir() if (f / FILE).is_file()]
    experiments = [load_experiment(f) for f in folders]
    return tuple(e.name for e in sorted(experiments, key=lambda e: (_first_figure(e), e.name)))


def find_experiments(words: Sequence[str]) -> tuple[Experiment, ...]:
    """Load experiments.

    Args:
        words: Names of examples or paths of folders; all examples if there are none.

    Raises:
        ExperimentError: A word is neither (`unknown-experiment`), or two experiments have one name
            (`name-not-unique`).
        DeviceError: A file of an experiment is invalid.
    """
    known = example_names()
    experiments = [load_experiment(_find_folder(word, known)) for word in words or known]
    names = [e.name for e in experiments]
    repeated = next((n for n in names if names.count(n) > 1), None)
    if repeated is not None:
        raise ExperimentError(
            "is given twice; results are stored by that name",
            code="name-not-unique",
            where=repeated,
            action="Give it once, or rename a folder",
            name=repeated,
        )
    return tuple(experiments)


def _find_folder(word: str, known: Sequence[str]) -> Path:
    if word in known:
        return _examples_folder() / word
    path = Path(word)
    if path.is_dir():
        return path
    similar = difflib.get_close_matches(word, known, n=1)
    raise ExperimentError(
        "is neither an example nor a folder",
        code="unknown-experiment",
        where=word,
        action=f"Did you mean {similar[0]}?" if similar else f"Use one of {', '.join(known)}",
        suggestion=similar[0] if similar else None,
        known=tuple(known),
    )


def _examples_folder() -> Path:
    return package_data("examples")


def _first_figure(experiment: Experiment) -> int:
    """Return the number of the first figure of the paper that an experiment reproduces."""
    figures = [f for f in experiment.figures if f.startswith("Fig")]
    numbers = ["".join(c for c in f if c.isdigit()) for f in figures]
    return min((int(n) for n in numbers if n), default=LAST_FIGURE)
