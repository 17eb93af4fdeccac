"""Damaged training data, each tried on the command line: what is said, and with which exit code.

    defsense twin my-device --minutes 4 --sessions 2
    python -m benchmarks.bad_training_data my-device/twin-1-1/session-* --device my-device

Two processed sessions of one built device, of a run each, are cut to so many seconds, and each
fault is made in a copy: the files that a user would have. `defsense train` (or what the fault is
about) is run on it. Told are the exit code and the words that the same command does not say of the
whole sessions. A fault is caught where training refuses (exit code 2, one line, no model) or, of
those that are marked `told`, where it says what is doubtful and trains all the same; `no one` is
told of what is no fault. `--only WORD` tries those whose names have the word.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.damage import channels, files, frames
from benchmarks.damage.copies import FAULTS, QUICK, REFUSED, TOLD, Fault, Place, Words, run, shorter

_ROOMS = (channels, frames, files)  # each adds its own to FAULTS
#: What is said of whole sessions, too.
_USUAL = ("note: *:", "note: trained on", "note: memory", "note: 100% of the simulated")
_PAIRS = ("in the device's frame as given", "R0: that of the file's own", "R0: the median at rest")


def tried(one: Fault, place: Place) -> tuple[bool, int | None, list[str]]:
    """Whether it was caught, the exit code, and what was said."""
    place.new.mkdir()
    try:
        words = one.make(place)
        out = place.new / ("page" if words[0] == "evaluate" else "model.json")
        before = set(place.new.iterdir())
        code, said = run([*words, "--out", out])
        written = sorted(p.name for p in set(place.new.iterdir()) - before)
    finally:
        shutil.rmtree(place.new)
    told = [line.replace(f"{place.new}/", "") for line in said]
    told = [x for x in told if not x.startswith(_USUAL) and not any(w in x for w in _PAIRS)]
    if one.due == REFUSED:
        good = code == 2 and len(told) == 1 and not written
    else:
        good = code == 0 and bool(told) == (one.due == TOLD) and written == [out.name]
    if written and code != 0:
        told.append(f"left behind: {', '.join(written)}")
    return good, code, told


@contextlib.contextmanager
def places(options: argparse.Namespace) -> Iterator[Place]:
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made).resolve()
        whole = [Path(shutil.copytree(s, folder / f"session-{k}")) for k, s in
                 enumerate((options.first, options.second), 1)]  # fmt: skip
        for session in whole:
            shorter(session, options.seconds)
        told = json.loads((whole[0] / "session.json").read_text(encoding="utf-8"))
        model = folder / "model.json"
        words: Words = ["train", whole[0], "--device", options.device, *QUICK, "--out", model]
        code, said = run(words)
        if code != 0:
            sys.exit(f"the whole session cannot be trained on: {said}")
        channels = tuple(told["channels"])
        yield Place(whole[0], whole[1], options.device, channels, model, folder / "new")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("first", type=Path)
    parser.add_argument("second", type=Path)
    parser.add_argument("--device", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    os.environ["COLUMNS"] = "500"
    bad = count = 0
    with places(options) as place:
        for one in FAULTS:
            if options.only not in one.name:
                continue
            good, code, told = tried(one, place)
            count, bad = count + 1, bad + (not good)
            exit_code = "traceback" if code is None else code
            print(f"{'' if good else 'NOT CAUGHT: '}{one.name} [{one.due}]: exit {exit_code}")
            print("".join(f"    {line}\n" for line in told), end="", flush=True)
    print(f"{count - bad} of {count} faults are answered as is due")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
