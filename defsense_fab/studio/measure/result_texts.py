"""What trainings and evaluations tell, as markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def decoder_table(told: Mapping[str, Any]) -> str:
    """Errors by decoder, of what a model's training told; empty where it tells none."""
    candidates = told.get("candidates") or ()
    if not candidates:
        return ""
    lines = ["| decoder | folds | test | peak |", "|---|---:|---:|---:|"]
    for row in candidates:
        name, test = row["decoder"], row.get("test")
        shown = f"**{name}**" if name == told.get("decoder") else name
        cells = ["-", "-"]
        if test is not None:
            cells = [f"{test['rmse']:.2f}", f"{test['peak']:.2f}"]
        lines.append(f"| {shown} | {row['cross_validated']:.2f} | {' | '.join(cells)} |")
    about = "Errors of markers, mm (RMSE; the largest); bold: chosen by the folds."
    pictures = told.get("pictures")
    if isinstance(pictures, Mapping):
        about += (
            f" Trained on {pictures['trained']} pictures, tested on the {pictures['tested']} after."
        )
    return "\n".join([*lines, "", about])


def test_words(told: Mapping[str, Any]) -> str:
    """The error of the decoder that was chosen, in a line; empty where none was tested."""
    for row in told.get("candidates") or ():
        test = row.get("test")
        if row["decoder"] == told.get("decoder") and test is not None:
            return f"In its test: **{test['rmse']:.2f} mm** (peak {test['peak']:.1f} mm)"
    return ""


def trained_words(result: Mapping[str, Any]) -> str:
    """Of a training that has just ended."""
    parts = [f"Wrote `{result['path']}`.", decoder_table(result["told"])]
    if "trained_on" in result["told"]:
        parts.append(
            f"It knows {result['told']['trained_on']}: nothing of this device was measured; expect"
            " errors of several times the prediction until it is trained on a session."
        )
    return "\n\n".join(part for part in [*parts, notes_list(result["notes"])] if part)


def evaluated_words(result: Mapping[str, Any]) -> str:
    """Of an evaluation that has just ended."""
    n = result["numbers"]
    table = (
        "| RMSE ± SD | peak | average peak | frames |\n|---:|---:|---:|---:|\n"
        f"| {n['RMSE']:.2f} ± {n['SD']:.2f} | {n['peak']:.2f} | {n['average peak']:.2f} |"
        f" {n['frames']} |\n\nErrors of markers on pictures that were not trained on, mm. All of"
        f" it: `{result['page']}`"
    )
    return "\n\n".join(part for part in [table, notes_list(result["notes"])] if part)


def notes_list(notes: Sequence[str]) -> str:
    """As a list; empty for none."""
    return "\n".join(f"- {note}" for note in notes)


def short(path: str | Path, folder: Path) -> str:
    """A path as it is called in the device's folder."""
    path = Path(path)
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)
