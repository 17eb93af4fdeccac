"""Options of training, evaluation and export, and the data that they read."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from ..capture.files.length_units import LengthUnit
from ..core.errors import TrainingError
from ..core.schema.options import check_options

#: Suffixes of XDF files.
XDF_SUFFIXES = (".xdf", ".xdfz")
#: A time between two clocks in s, or "auto" to find it in the data.
ClockShift = Annotated[float, Meta(ge=-1e12, le=1e12)] | Literal["auto"]
#: Forms of decoders, the simplest first.
DecoderForm = Literal["affine", "quadratic", "kernel"]
#: Whether the simulation of a device is used; "auto": if the device is built.
PriorMode = Literal["auto", "yes", "no"]


@dataclass(frozen=True)
class DataFiles:
    """Data to train or test on.

    Attributes:
        sources: Read processed sessions, datasets, or XDF files; the kind is detected from the
            content.
        signals: Read signals or resistances over time from these tables (.csv), one for each run;
            needs targets or tracks.
        tracks: Read the markers from these files (.csv, .npz, .parquet, .c3d, .trc), one for each
            file of signals.
        targets: Read what to decode from these tables (.csv), one for each file of signals: angles,
            forces or positions with their units, such as angle_deg.
        tracks_unit: Set the unit of the tracks' positions, for a file that does not state it.
        signals_stream: Choose the stream of signals in XDF files: its name, its type, or name and
            number, such as Board#3.
        tracks_stream: Choose the stream of tracks in XDF files, in the same way.
        markers: Set the file of the markers' positions at rest (default: markers.json of the
            device).
        offset: Set the time in s by which the tracks' clock is ahead, or auto to find it.
        shift: Set the time in s to add to the times of the signals, or auto to find it.
        unit: Set the name of the built device that an XDF file or a table of
            signals is of.

    Raises:
        TrainingError: Files of signals are given without as many of tracks or targets, or the
            other way round (`file-not-found`), `tracks_unit` is given without `tracks` or a stream
            without an XDF file (`options-conflict`), or a time is not a finite number
            (`out-of-range`).
    """

    sources: tuple[Path, ...] = ()
    _: KW_ONLY
    signals: tuple[Path, ...] = ()
    tracks: tuple[Path, ...] = ()
    targets: tuple[Path, ...] = ()
    tracks_unit: LengthUnit | None = None
    signals_stream: str | None = None
    tracks_stream: str | None = None
    markers: Path | None = None
    offset: ClockShift = 0.0
    shift: ClockShift = 0.0
    unit: str = ""

    def __post_init__(self) -> None:
        for name in ("signals", "tracks", "targets"):  # one file may be given as such
            if isinstance(value := getattr(self, name), str | Path):
                object.__setattr__(self, name, (Path(value),))
        check_options(self, TrainingError)
        self._check_pairs()
        if self.tracks_unit is not None and not self.tracks:
            raise TrainingError(
                "has no effect without a file of tracks",
                code="options-conflict",
                where="tracks_unit",
                action="Omit it, or give tracks",
                option="tracks_unit",
            )
        has_xdf = any(source.suffix.lower() in XDF_SUFFIXES for source in self.sources)
        for option in ("signals_stream", "tracks_stream"):
            if getattr(self, option) is not None and not has_xdf:
                raise TrainingError(
                    "has no effect without an XDF file",
                    code="options-conflict",
                    where=option,
                    action="Omit it, or give an XDF file",
                    option=option,
                )

    def _check_pairs(self) -> None:
        """Raise an error unless each file of signals has one of tracks or of targets."""
        if self.tracks and self.targets:
            raise TrainingError(
                "cannot be given together with tracks",
                code="options-conflict",
                where="targets",
                action="Give tracks for markers, or targets for anything else",
                option="targets",
            )
        truth = "targets" if self.targets else "tracks"
        count = len(self.targets or self.tracks)
        if len(self.signals) == count:
            return
        missing = truth if count < len(self.signals) else "signals"
        given = "signals" if missing == truth else truth
        if not (self.signals and count):
            needed = "tracks or targets" if given == "signals" else "signals"
            raise TrainingError(
                f"is missing: {given} need {needed}",
                code="file-not-found",
                where=missing,
                action="Give both",
                missing=missing,
            )
        raise TrainingError(
            f"{len(self.signals)} files of signals do not pair with {count} of {truth}",
            code="file-not-found",
            where=missing,
            action="Give one of each for every run, in the same order",
            missing=missing,
        )

    @property
    def is_empty(self) -> bool:
        """Whether there are no data."""
        return not self.sources and not self.signals


@dataclass(frozen=True)
class TrainOptions:
    """Options of a training. The share of the test is that of DefSense (CHI 2016, section 6).

    Attributes:
        decoder: Choose the form of the decoder, or auto for the best.
        memory: Try decoders with a memory of past signals.
        weighted: Weight markers by their certainty, and leave out wrong ones.
        test_share: Set the share of the pictures, at the end of all runs in order, to test on.
        leave_out: Test on these whole runs, such as walk-2,walk-3, in place of a share.
        folds: Set the number of contiguous folds for cross-validation.
        level: Set the probability that a marker lies within its interval.
        prior: Train on the simulation of the device too: auto if it is built.
        without_markers: Leave out the markers with these numbers, such as 4,7.
        without_channels: Leave out the channels with these names, such as left,right.
        in_step: State that the clocks of signals and markers agree; the model's file records it.

    Raises:
        TrainingError: A number is out of range (`out-of-range`), or a name is not one of the
            choices (`unknown-choice`).
    """

    decoder: Literal[DecoderForm, "auto"] = "auto"
    memory: bool = True
    weighted: bool = True
    test_share: Annotated[float, Meta(ge=0, le=0.99)] = 0.3
    folds: Annotated[int, Meta(ge=2, le=1000)] = 5
    level: Annotated[float, Meta(ge=0.001, le=0.9999)] = 0.9
    prior: PriorMode = "auto"
    without_markers: tuple[Annotated[int, Meta(ge=0)], ...] = ()
    without_channels: tuple[str, ...] = ()
    leave_out: tuple[str, ...] = ()
    in_step: bool = False

    def __post_init__(self) -> None:
        check_options(self, TrainingError)


@dataclass(frozen=True)
class EvaluateOptions:
    """Options of an evaluation.

    Attributes:
        against: Compare with these models, tested on the same data.
        last_share: Set the share of the pictures to test on, at the end (default: all that the
            models were not trained on).
        out: Set the output folder (default: evaluation, next to the model).

    Raises:
        TrainingError: The share is out of range (`out-of-range`).
    """

    against: tuple[Path, ...] = ()
    last_share: Annotated[float, Meta(ge=0.001, le=1)] | None = None
    out: Path | None = None

    def __post_init__(self) -> None:
        check_options(self, TrainingError)


@dataclass(frozen=True)
class ExportOptions:
    """Formats and folders of an exported dataset.

    Attributes:
        out: Set the output folder for Parquet; an existing dataset is replaced.
        lerobot: Set the output folder for LeRobot's format 2.1; it must not exist.
        rate: Set the rate of LeRobot's frames in Hz (default: that of the pictures).

    Raises:
        TrainingError: The rate is out of range (`out-of-range`), or given without `lerobot`
            (`options-conflict`).
    """

    out: Path | None = None
    lerobot: Path | None = None
    rate: Annotated[int, Meta(ge=1, le=1000)] | None = None

    def __post_init__(self) -> None:
        check_options(self, TrainingError)
        if self.rate is not None and self.lerobot is None:
            raise TrainingError(
                "applies to LeRobot's format only; Parquet keeps the original times",
                code="options-conflict",
                where="rate",
                action="Omit it, or give a folder for LeRobot's format",
                option="rate",
            )
