"""Read `experiment.toml` into an Experiment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from ....core.device.device_file import DEVICE, read_device
from ....core.errors import DeviceError, ExperimentError
from ....core.schema.declare import Problem, Table, key, missing, unknown_choice
from ....core.schema.document import Document, errors_in, load_document
from ....core.storage.file_names import fold_name
from .experiment import (
    AFFINE,
    BENT_QUANTITIES,
    CHOSEN,
    CORD_QUANTITIES,
    QUANTITIES,
    TOLD_APART,
    CordPlan,
    Experiment,
    LayoutChoice,
    PaperNumber,
    QuickPlan,
    SessionPlan,
)

FILE = "experiment.toml"


class NumberTable(Table, frozen=True, kw_only=True):
    """A number that is reported, with the paper's."""

    layout: Annotated[
        str | None, key("Layout of the number.", default="required with `[[layouts]]`")
    ] = None
    cord: Annotated[
        str | None, key("Kind of cord of the number.", default="required with `[cords]`")
    ] = None
    quantity: Annotated[
        str,
        key("Quantity, as listed below.", choices=dict.fromkeys((*QUANTITIES, *CORD_QUANTITIES))),
    ]
    over: Annotated[
        str | None,
        key("Layout or cord by whose number it is divided.", default="none: not a ratio"),
    ] = None
    decoder: Annotated[
        str,
        key(
            "Decoder: the paper's (`affine`), or the one that training chooses.",
            choices=(AFFINE, CHOSEN),
        ),
    ] = CHOSEN
    paper: Annotated[float | None, key("Number in the paper.", default="none")] = None
    where: Annotated[
        str | None, key("Place of that number in the paper.", default="required with `paper`")
    ] = None
    at_most: Annotated[float | None, key("Largest number that is expected.", default="any")] = None
    at_least: Annotated[float | None, key("Smallest number that is expected.", default="any")] = (
        None
    )
    why: Annotated[str | None, key("Reason why ours differs from the paper's.", default="none")] = (
        None
    )

    def check(self) -> Iterator[Problem]:
        """Yield problems of keys that need or exclude each other."""
        if self.decoder == AFFINE and self.quantity == TOLD_APART:
            text = f"{self.quantity} is a quantity of the chosen decoder"
            yield Problem(("decoder",), text, "key-not-applicable", "Remove it")
        if self.at_most is not None and self.at_least is not None:
            text = "one bound is enough"
            yield Problem(("at_least",), text, "keys-exclusive", "Remove this key or at_most")
        if self.paper is not None and not (self.where or "").strip():
            text = "is missing: the place of the number in the paper"
            yield Problem(("where",), text, "key-missing", "Add it")

    def record(self) -> PaperNumber:
        """Return the number."""
        return PaperNumber(
            self.layout or self.cord or "",
            self.quantity,
            self.over,
            self.decoder,
            self.paper,
            (self.where or "").strip(),
            self.at_most,
            self.at_least,
            (self.why or "").strip(),
        )


class ExperimentFile(Table, frozen=True, kw_only=True):
    """All keys of `experiment.toml`."""

    schema: Annotated[Literal[1], key("Version of this format.")] = 1
    title: Annotated[str, key("Title of the experiment.")]
    figures: Annotated[tuple[str, ...], key("Figures and tables of the paper.")] = ()
    about: Annotated[str, key("What the experiment shows, in one or two sentences.")]
    layouts: Annotated[
        tuple[LayoutChoice, ...],
        key(
            "Layouts that are compared, in the order of the page.",
            default="required without `[cords]`",
        ),
    ] = ()
    session: Annotated[SessionPlan, key("How each built device is recorded.")] = msgspec.field(
        default_factory=SessionPlan
    )
    quick: Annotated[QuickPlan, key("What `--quick` uses instead.")] = msgspec.field(
        default_factory=QuickPlan
    )
    cords: Annotated[
        CordPlan | None,
        key("An experiment of cords alone.", default="required without `[[layouts]]`"),
    ] = None
    numbers: Annotated[tuple[NumberTable, ...], key("Numbers that are reported.")] = ()

    def check(self) -> Iterator[Problem]:
        """Yield problems of what is compared, and of names."""
        if bool(self.layouts) == (self.cords is not None):
            text = "an experiment is either of a device or of cords"
            action = "Give either [[layouts]] of a device to compare, or [cords]"
            yield Problem(("layouts",), text, "keys-exclusive", action)
            return
        names = [fold_name(layout.name) for layout in self.layouts]
        for position, layout in enumerate(self.layouts):
            if names[position] in names[:position]:
                path = ("layouts", position, "name")
                text = f"{layout.name!r} is used already"
                yield Problem(path, text, "duplicate-names", "Choose another name")
        for position, number in enumerate(self.numbers):
            for problem in self._check_number(number):
                yield problem.below("numbers", position)

    def _check_number(self, number: NumberTable) -> Iterator[Problem]:
        """Yield problems of a number's layout or cord, and of its quantity."""
        names: Sequence[str]
        quantities: Sequence[str]
        if self.cords is None:
            subject, other = "layout", "cord"
            names, quantities = [layout.name for layout in self.layouts], QUANTITIES
        else:
            subject, other = "cord", "layout"
            names, quantities = self.cords.kinds, CORD_QUANTITIES
        if getattr(number, other) is not None:
            text = f"this experiment has no {other}s"
            yield Problem((other,), text, "key-not-applicable", f"Use {subject}")
            return
        name, code = getattr(number, subject), f"unknown-{subject}"
        if name is None:
            yield missing(subject)
            return
        if name not in names:
            yield unknown_choice((subject,), name, names, subject, code)
        if number.quantity not in quantities:
            path = ("quantity",)
            yield unknown_choice(path, number.quantity, quantities, "quantity", "unknown-quantity")
        elif self.cords is not None and number.quantity in BENT_QUANTITIES:
            bent = self.cords.kinds[0]
            if {name, number.over} - {None, bent}:
                text = f"{number.quantity} is known of {bent} alone, which is on the specimens"
                yield Problem(("quantity",), text, "cord-not-bent")
        if number.over is not None and number.over not in names:
            yield unknown_choice(("over",), number.over, names, subject, code)
        elif number.over == name:
            text = f"the ratio of {name} to itself is 1"
            yield Problem(("over",), text, "ratio-to-itself", f"Name another {subject}")


def load_experiment(folder: Path) -> Experiment:
    """Read the experiment of a folder.

    Args:
        folder: Folder with `experiment.toml`, and with `device.toml` unless it is of cords alone.

    Raises:
        ExperimentError: with file, line and key, for everything that is wrong in the file.
        DeviceError: if a file with drawn cords is not valid TOML.
    """
    path = folder / FILE
    if not path.is_file():
        raise ExperimentError(
            "no such file",
            code="file-not-found",
            where=path,
            action=f"Give a folder that holds an {FILE} (docs/reproduce.md)",
        )
    document = load_document(path, ExperimentError)
    declared = document.read(ExperimentFile)
    problems = list(_check_files(declared, folder))
    if problems:
        document.refuse(problems)
    return Experiment(
        name=folder.resolve().name,
        folder=folder,
        title=declared.title,
        figures=declared.figures,
        about=declared.about,
        layouts=declared.layouts,
        session=declared.session,
        small=declared.quick,
        numbers=tuple(number.record() for number in declared.numbers),
        cords=declared.cords,
    )


def _check_files(declared: ExperimentFile, folder: Path) -> Iterator[Problem]:
    """Yield problems of the device and of files with drawn cords."""
    if declared.layouts and not (folder / DEVICE).is_file():
        text = f"are of a device, and {folder} holds no {DEVICE}"
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
