"""The examples that come with the package, and folders of one's own, by what is typed."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path

from ....core.errors import ExperimentError
from ....core.storage.package_data import package_data
from .experiment import Experiment
from .experiment_file import FILE, load_experiment


def example_names() -> tuple[str, ...]:
    """Of the package's own, in the order of the paper's figures."""
    found = [load_experiment(f) for f in _folder().iterdir() if (f / FILE).is_file()]
    return tuple(e.name for e in sorted(found, key=lambda e: (_first_figure(e), e.name)))


def find_experiments(words: Sequence[str]) -> tuple[Experiment, ...]:
    """By names of examples or paths of folders; all examples where there is no word. Raises
    ExperimentError for a word that is neither, and where two have one name, DeviceError for what
    is wrong in their files."""
    known = example_names()
    found = [load_experiment(_place(word, known)) for word in words or known]
    names = [e.name for e in found]
    twice = next((n for n in names if names.count(n) > 1), None)
    if twice is not None:
        raise ExperimentError(
            f"{twice}: is given twice, and results go by that name; give it once, or rename a"
            " folder"
        )
    return tuple(found)


def _place(word: str, known: Sequence[str]) -> Path:
    if word in known:
        return _folder() / word
    path = Path(word)
    if path.is_dir():
        return path
    near = difflib.get_close_matches(word, known, n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    raise ExperimentError(
        f"{word}: is neither an example nor a folder; {hint}examples are {', '.join(known)}"
    )


def _folder() -> Path:
    return package_data("examples")


def _first_figure(experiment: Experiment) -> int:
    """Its number, by which readers of the paper look."""
    figures = [f for f in experiment.figures if f.startswith("Fig")]
    numbers = ["".join(c for c in f if c.isdigit()) for f in figures]
    return min((int(n) for n in numbers if n), default=99)
