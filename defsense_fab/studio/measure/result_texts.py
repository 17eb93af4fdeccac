"""Texts of the Measure mode: the status of a part, and the results of its jobs in markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...core.errors import DefsenseError
from .jobs import EvaluationResult, FitResult, TrainingResult


class StatusText:
    """The status of a part of the panel.

    Args:
        gui: The viser server's gui; the text is added to its open folder.

    Attributes:
        text: The text in markdown.
        code: Identifier of the status, such as "busy", or the code of the error; empty for progress
            and results.
        error: The error that is shown, or None.
    """

    def __init__(self, gui: Any) -> None:
        self._handle = gui.add_markdown("")
        self.text, self.code = "", ""
        self.error: Exception | None = None

    def show(self, text: str, code: str = "") -> None:
        """Show a text in markdown."""
        self.text, self.code, self.error = text, code, None
        self._handle.content = text

    def show_problem(self, text: str, code: str) -> None:
        """Show in bold what the user has to do first."""
        self.show(f"**{text}**", code)

    def show_error(self, error: Exception, task: str = "") -> None:
        """Show an error; the studio continues.

        Args:
            error: The error.
            task: Subject of the sentence about a fault of the program, such as "The recording".
        """
        if isinstance(error, DefsenseError):
            self.show_problem(str(error), error.code)
        elif task:
            self.show_problem(f"{task} failed ({type(error).__name__}: {error}).", "task-failed")
        else:
            self.show_problem(str(error), "task-failed")
        self.error = error


def decoder_table(metadata: Mapping[str, Any]) -> str:
    """Return the errors of the decoders of a training in markdown.

    Args:
        metadata: Metadata of the model's training.

    Returns:
        The table; empty if the metadata contain no errors.
    """
    candidates = metadata.get("candidates") or ()
    if not candidates:
        return ""
    lines = ["| Decoder | Folds | Test | Peak |", "|---|---:|---:|---:|"]
    for row in candidates:
        name, test = row["decoder"], row.get("test")
        label = f"**{name}**" if name == metadata.get("decoder") else name
        cells = ["-", "-"]
        if test is not None:
            cells = [f"{test['rmse']:.2f}", f"{test['peak']:.2f}"]
        lines.append(f"| {label} | {row['cross_validated']:.2f} | {' | '.join(cells)} |")
    note = "Errors of the markers in mm (RMSE; peak: the largest). Bold: chosen by the folds."
    images = metadata.get("pictures")
    if isinstance(images, Mapping):
        note += (
            f" Trained on {images['trained']} images and tested on the {images['tested']} that"
            " follow."
        )
    return "\n".join([*lines, "", note])


def decoder_error_text(metadata: Mapping[str, Any]) -> str:
    """Return the test error of the chosen decoder; empty if it was not tested."""
    for row in metadata.get("candidates") or ():
        test = row.get("test")
        if row["decoder"] == metadata.get("decoder") and test is not None:
            return f"Test error: **{test['rmse']:.2f} mm** (peak {test['peak']:.1f} mm)"
    return ""


def training_text(result: TrainingResult) -> str:
    """Return the result of a training in markdown."""
    parts = [f"Wrote `{result.path}`.", decoder_table(result.metadata)]
    if "trained_on" in result.metadata:
        parts.append(
            f"The model was trained on {result.metadata['trained_on']} and not on measurements of"
            " this device. Expect errors several times the prediction until you train on a session."
        )
    return "\n\n".join(part for part in [*parts, bullet_list(result.notes)] if part)


def evaluation_text(result: EvaluationResult) -> str:
    """Return the result of an evaluation in markdown."""
    table = (
        "| RMSE ± SD | Peak | Average peak | Frames |\n|---:|---:|---:|---:|\n"
        f"| {result.rmse:.2f} ± {result.deviation:.2f} | {result.peak:.2f} |"
        f" {result.average_peak:.2f} | {result.frames} |\n\n"
        "Errors of the markers in mm, on images that were not used for training. Full report:"
        f" `{result.page}`"
    )
    return "\n\n".join(part for part in [table, bullet_list(result.notes)] if part)


def response_text(result: FitResult) -> str:
    """Return a fitted response in markdown."""
    data = result.data
    low, high = data["interval"]
    strains = data["strain_range"]
    parts = (
        f"**k_res = {data['k_res']:.2f}** (95 % interval: {low:.2f} to {high:.2f})",
        str(data["reason"]),
        f"Strains from {strains[0]:.1%} to {strains[1]:.1%}, {data['readings']} readings of"
        f" {len(data['pieces'])} pieces. Full report: `{result.page}`",
        bullet_list(data["warnings"]),
    )
    return "\n\n".join(part for part in parts if part)


def bullet_list(lines: Sequence[str]) -> str:
    """Return lines as a list in markdown; empty for none."""
    return "\n".join(f"- {line}" for line in lines)


def relative_name(path: str | Path, folder: Path) -> str:
    """Return a path relative to the device's folder if it is inside, else the whole path."""
    path = Path(path)
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)
