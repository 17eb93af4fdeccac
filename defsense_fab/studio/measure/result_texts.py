"""Results of the jobs of the Measure mode in markdown."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..workbench.page_texts import bullet_list, markdown_table
from .jobs import EvaluationResult, TrainingResult


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
    rows = []
    for row in candidates:
        name, test = row["decoder"], row.get("test")
        label = f"**{name}**" if name == metadata.get("decoder") else name
        cells = ["-", "-"]
        if test is not None:
            cells = [f"{test['rmse']:.2f}", f"{test['peak']:.2f}"]
        rows.append([label, f"{row['cross_validated']:.2f}", *cells])
    note = "Errors of the markers in mm (RMSE; peak: the largest). Bold: chosen by the folds."
    images = metadata.get("pictures")
    if isinstance(images, Mapping):
        note += (
            f" Trained on {images['trained']} images and tested on the {images['tested']} that"
            " follow."
        )
    return f"{markdown_table(['Decoder', 'Folds', 'Test', 'Peak'], rows)}\n\n{note}"


def decoder_error_text(metadata: Mapping[str, Any]) -> str:
    """Return the test error of the chosen decoder; empty if it was not tested."""
    for row in metadata.get("candidates") or ():
        test = row.get("test")
        if row["decoder"] == metadata.get("decoder") and test is not None:
            text = f"Test error: **{test['rmse']:.2f} mm** (peak {test['peak']:.1f} mm)"
            return "\n\n".join(part for part in [useless_text(metadata), text] if part)
    return ""


def useless_text(metadata: Mapping[str, Any]) -> str:
    """Return why the test found a model useless, in bold; empty for a useful one."""
    message = (metadata.get("usefulness") or {}).get("message")
    return f"**{message[0].upper()}{message[1:]}**" if message else ""


def training_text(result: TrainingResult) -> str:
    """Return the result of a training in markdown."""
    parts = [
        useless_text(result.metadata),
        f"Wrote `{result.path}`.",
        decoder_table(result.metadata),
    ]
    if "trained_on" in result.metadata:
        parts.append(
            f"The model was trained on {result.metadata['trained_on']} and not on measurements of"
            " this device. Expect errors several times the prediction until you train on a session."
        )
    return "\n\n".join(part for part in [*parts, bullet_list(result.notes)] if part)


def evaluation_text(result: EvaluationResult) -> str:
    """Return the result of an evaluation in markdown."""
    total = result.total
    numbers = (total.peak, total.average_peak)
    row = [f"{total.rmse:.2f} ± {total.deviation:.2f}", *(f"{x:.2f}" for x in numbers)]
    table = markdown_table(
        ["RMSE ± SD", "Peak", "Average peak", "Frames"], [[*row, str(total.frames)]], "r"
    )
    note = (
        "Errors of the markers in mm, on images that were not used for training. Full report:"
        f" `{result.page}`"
    )
    return "\n\n".join(part for part in [table, note, bullet_list(result.notes)] if part)


def response_text(data: Mapping[str, Any], page: Path) -> str:
    """Return a fitted response in markdown.

    Args:
        data: Content of `response.json`.
        page: File of the report.
    """
    low, high = data["interval"]
    strains = data["strain_range"]
    parts = (
        f"**k_res = {data['k_res']:.2f}** (95 % interval: {low:.2f} to {high:.2f})",
        str(data["reason"]),
        f"Strains from {strains[0]:.1%} to {strains[1]:.1%}, {data['readings']} readings of"
        f" {len(data['pieces'])} pieces. Full report: `{page.resolve()}`",
        bullet_list(data["warnings"]),
    )
    return "\n\n".join(part for part in parts if part)


def relative_name(path: str | Path, folder: Path) -> str:
    """Return a path relative to the device's folder if it is inside, else the whole path."""
    path = Path(path)
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)
