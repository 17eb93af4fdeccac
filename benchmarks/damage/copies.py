"""Copies of sessions to damage, and the commands that are run on them."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from defsense_fab.capture.files.formats import read_tracks, write_tracks
from defsense_fab.capture.sessions.result_files import ALIGNED, QUALITY, SAMPLES, SIGNALS
from defsense_fab.cli.main import main as defsense
from defsense_fab.core.arrays import Float
from defsense_fab.core.markers import Tracks
from defsense_fab.training.recordings.series import read_table

REFUSED, TOLD, SILENT = "refused", "told", "no one"
QUICK = ("--decoder", "affine", "--no-memory")


@dataclass(frozen=True)
class Place:
    """Whole sessions `a` and `b`, the built `device`, its `channels`, a `model` of `a`, and an
    empty folder `new` for damaged copies."""

    a: Path
    b: Path
    device: Path
    channels: tuple[str, ...]
    model: Path
    new: Path

    def copy(self, of: Path | None = None) -> Path:
        """Of a session."""
        return Path(shutil.copytree(of or self.a, self.new / (of or self.a).name))


Words = list[str | Path]


@dataclass(frozen=True)
class Fault:
    """What is damaged by `make`, which returns the command's words; what is `due`."""

    name: str
    due: str
    make: Callable[[Place], Words]


FAULTS: list[Fault] = []


def fault(name: str, due: str = REFUSED) -> Callable[[Callable[[Place], Words]], None]:
    def add(make: Callable[[Place], Words]) -> None:
        FAULTS.append(Fault(name, due, make))

    return add


def columns(path: Path, change: Callable[[dict[str, Float]], None]) -> None:
    """Of a table, by their names."""
    table = read_table(path)
    values = {name: table[name] for name in table.names}
    change(values)
    rows = np.column_stack(list(values.values()))
    lines = [",".join("" if np.isnan(x) else f"{x:.9g}" for x in row) for row in rows]
    head = ",".join(values)
    if table.run:
        head, lines = f"run,{head}", [f"{table.run[0]},{line}" for line in lines]
    path.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")


def both(session: Path, change: Callable[[dict[str, Float]], None]) -> None:
    """The signals of the samples and those at the pictures."""
    for name in (SAMPLES, SIGNALS):
        columns(session / name, change)


def tracks(session: Path, change: Callable[[Tracks], Tracks]) -> None:
    write_tracks(session / ALIGNED, change(read_tracks(session / ALIGNED)))


def tell(path: Path, **changes: object) -> None:
    data = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(data | changes), encoding="utf-8")


def cut(path: Path, part: float = 0.6) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])


def shorter(session: Path, seconds: float) -> None:
    """Only its beginning."""
    for name in (SAMPLES, SIGNALS):
        table = read_table(session / name)
        keep = [True, *(table["time"] < seconds).tolist()]
        lines = (session / name).read_text(encoding="utf-8").splitlines()
        kept = [line for line, k in zip(lines, keep, strict=True) if k]
        (session / name).write_text("\n".join(kept) + "\n", encoding="utf-8")
    tracks(session, lambda t: t.part(t.time < seconds))
    tell(session / QUALITY, frames=len(read_tracks(session / ALIGNED).time))


def train(place: Place, *words: str | Path, device: bool = True) -> Words:
    given: Words = ["--device", place.device] if device else []
    return ["train", *words, *given, *QUICK]


def pair(place: Place, signals: Path, suffix: str = ".csv", session: Path | None = None) -> Words:
    """The options of two files of a session."""
    session = session or place.a
    take = place.new / f"take{suffix}"
    write_tracks(take, read_tracks(session / ALIGNED))
    return ["--signals", signals, "--tracks", take, "--markers", session / "markers.json"]


def edited(path: Path, line: int, column: int, cell: str) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    cells = lines[line].split(",")
    cells[column] = cell
    lines[line] = ",".join(cells)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def run(words: Words) -> tuple[int | None, list[str]]:
    """The exit code, None for a traceback, and what was said."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code: int | None = defsense([str(w) for w in words])
        except SystemExit as left:
            code = int(left.code or 0)
        except Exception:
            code = None
            err.write(traceback.format_exc())
    lines = [*out.getvalue().splitlines(), *err.getvalue().splitlines()]
    if code is None:
        return None, [next(x for x in reversed(lines) if x.strip())]
    kept = ("error: ", "note: ", "warning: ")
    return code, [line for line in lines if line.startswith(kept)]
