"""Read `experiment.toml`, and find experiments by name: examples, and folders of users."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from pathlib import Path

from ...core.device.device_file import DEVICE, read_device
from ...core.errors import DeviceError, ExperimentError
from ...core.schema.declare import Problem
from ...core.schema.document import Document, errors_in, load_document
from ...core.storage.package_data import package_data
from .experiment import Experiment, ExperimentFile, LayoutChoice
from .options import ReproduceOptions

FILE = "experiment.toml"
_NO_OPTIONS = ReproduceOptions()
LAST_FIGURE = 99  # sorts experiments without a figure to the end


def example_names() -> tuple[str, ...]:
    """Return the names of the package's examples, in the order of the paper's figures."""
    folders = [f for f in package_data("examples").iterdir() if (f / FILE).is_file()]
    experiments = [load_experiment(f) for f in folders]
    return tuple(e.name for e in sorted(experiments, key=lambda e: (_first_figure(e), e.name)))


def find_experiments(
    words: Sequence[str] = (), options: ReproduceOptions = _NO_OPTIONS
) -> tuple[Experiment, ...]:
    """Load experiments.

    Args:
        words: Names of examples or paths of folders; all examples if there are none.
        options: Size of the experiments.

    Raises:
        ExperimentError: A word is neither (`unknown-experiment`), or two experiments have one name
            (`name-repeated`).
        DeviceError: A file of an experiment is invalid.
    """
    examples = example_names()
    experiments = [load_experiment(_find_folder(word, examples)) for word in words or examples]
    names = [e.name for e in experiments]
    repeated = next((n for n in names if names.count(n) > 1), None)
    if repeated is not None:
        raise ExperimentError(
            "is given twice; results are stored by that name",
            code="name-repeated",
            where=repeated,
            action="Give it once, or rename a folder",
            name=repeated,
        )
    return tuple(e.at_size(quick=options.quick, units=options.units) for e in experiments)


def _find_folder(word: str, examples: Sequence[str]) -> Path:
    if word in examples:
        return package_data("examples") / word
    path = Path(word)
    if path.is_dir():
        return path
    similar = difflib.get_close_matches(word, examples, n=1)
    raise ExperimentError(
        "is neither an example nor a folder",
        code="unknown-experiment",
        where=word,
        action=f"Did you mean {similar[0]}?" if similar else f"Use one of {', '.join(examples)}",
        suggestion=similar[0] if similar else None,
        examples=tuple(examples),
    )


def _first_figure(experiment: Experiment) -> int:
    """Return the number of the first figure of the paper that an experiment reproduces."""
    figures = [f for f in experiment.file.figures if f.startswith("Fig")]
    numbers = ["".join(c for c in f if c.isdigit()) for f in figures]
    return min((int(n) for n in numbers if n), default=LAST_FIGURE)


def load_experiment(folder: Path) -> Experiment:
    """Read the experiment of a folder.

    Args:
        folder: Folder with `experiment.toml`, and with `device.toml` unless it is of cords alone.

    Raises:
        ExperimentError: The file does not exist, or is invalid (with line and key, all problems).
        DeviceError: A file with drawn cords is not valid TOML.
    """
    path = folder / FILE
    if not path.is_file():
        raise ExperimentError(
            "no such file",
            code="file-not-found",
            where=path,
            action=f"Give a folder that contains an {FILE} (docs/reproduce.md)",
        )
    document = load_document(path, ExperimentError)
    declared = document.read(ExperimentFile)
    problems = list(_check_files(declared, folder))
    if problems:
        document.refuse(problems)
    return Experiment(folder.resolve().name, folder, declared)


def _check_files(declared: ExperimentFile, folder: Path) -> Iterator[Problem]:
    """Yield problems of the device and of files with drawn cords."""
    if declared.layouts and not (folder / DEVICE).is_file():
        text = f"need a device, and {folder} contains no {DEVICE}"
        yield Problem(("layouts",), text, "file-not-found", f"Add a {DEVICE}")
        return
    for position, layout in enumerate(declared.layouts):
        if layout.file is not None:
            where = ("layouts", position, "file")
            if not (folder / layout.file).is_file():
                text = f"there is no {layout.file} in {folder}"
                yield Problem(where, text, "file-not-found", "Correct its name")
            elif not load_document(folder / layout.file).values.get("sensors"):
                text = f"{layout.file} has no [[sensors]]"
                yield Problem(where, text, "sensors-missing", f"Draw them as in {DEVICE}")
        for problem in _check_design(layout, folder / DEVICE):
            yield problem.below("layouts", position)


def _check_design(layout: LayoutChoice, path: Path) -> Iterator[Problem]:
    """Yield problems of values that the device does not accept in `[design]`.

    Other problems of `device.toml` are reported where it is read.
    """
    if not layout.design:
        return
    values = dict(load_document(path).values)
    values["design"] = {**values.get("design", {}), **layout.design}
    try:
        read_device(Document(values, path), path.parent, {})
    except DeviceError as error:
        for one in errors_in(error):
            if str(one.data.get("key")).startswith("design"):
                text = f"{one.data['key']}: {one.problem}"
                yield Problem(("design",), text, one.code, one.action)
