"""Compare the results of the whole toolkit with the numbers in golden.json.

Each step is run through the command line, from an empty cache, on copies of the devices in
`fixtures/devices`: build five devices, simulate and process a filmed session, train and evaluate a
model, replay a recording live. The results are reduced to numbers and to digests of files:

    python -m benchmarks.golden             # compare, and list every difference
    python -m benchmarks.golden --write     # replace golden.json, after an intended change
    python -m benchmarks.golden --only bar  # one device, or "session", "model", "live"

Builds are reproducible bit for bit on one processor architecture. On other processors the last
digits of predictions and the facets of parts may differ (docs/contributing/conventions.md).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
GOLDEN = Path(__file__).with_suffix(".json")
DEVICES = ("joystick", "bar", "twist-bar", "cube", "blob")
STEPS = (*DEVICES, "session", "model", "live")
_MAIN = "import sys; from defsense_fab.cli.main import main; sys.exit(main(sys.argv[1:]))"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="replace golden.json")
    parser.add_argument("--only", nargs="+", choices=STEPS, default=STEPS, help="steps to run")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        results = collect_results(Path(folder), options.only)
    expected = json.loads(GOLDEN.read_text()) if GOLDEN.exists() else {}
    if options.write:
        GOLDEN.write_text(json.dumps(expected | results, indent=1) + "\n")
        return 0
    differences = [
        line for step in results for line in compare(step, expected.get(step), results[step])
    ]
    print("\n".join(differences) or f"identical: {', '.join(results)}")
    return int(bool(differences))


def collect_results(folder: Path, steps: tuple[str, ...] | list[str]) -> dict[str, Any]:
    """Run the steps in `folder` and return their numbers and digests by step."""
    os.environ["DEFSENSE_CACHE"] = str(folder / "cache")
    os.environ["COLUMNS"] = "200"
    results: dict[str, Any] = {}
    measured = any(step not in DEVICES for step in steps)
    for name in DEVICES:
        if name in steps or (name == "bar" and measured):
            device = folder / name
            shutil.copytree(
                ROOT / "fixtures/devices" / name,
                device,
                ignore=shutil.ignore_patterns("build", ".*"),
            )
            run("build", device)
        if name in steps:
            results[name] = describe_build(folder / name / "build")
    bar = folder / "bar"
    if "session" in steps:
        run("capture", "markers", bar)
        filmed = folder / "filmed"
        run(
            "twin",
            bar,
            "--minutes",
            "0.3",
            "--seed",
            "4",
            "--cameras",
            "webcam,cameras=2",
            "--rate",
            "10",
            "--out",
            filmed,
        )
        results["session"] = digests(filmed, ("*.csv", "*.npz"))
    if "model" in steps or "live" in steps:
        run("twin", bar, "--minutes", "3", "--seed", "3", "--out", folder / "twin")
        (folder / "model").mkdir()
        run("train", folder / "twin", "--device", bar, "--out", folder / "model" / "model.json")
    if "model" in steps:
        text = run(
            "evaluate",
            folder / "model" / "model.json",
            folder / "twin",
            "--last-share",
            "0.3",
            "--json",
            "--out",
            folder / "evaluation",
        )
        errors = json.loads(text)
        del errors["test"]  # the errors and intervals of `models` in other words
        results["model"] = {
            "recording": digests(folder / "twin", ("*.csv", "*.npz")),
            "coefficients": digest(
                numbers(json.loads((folder / "model" / "model.json").read_text()))
            ),
            "errors": round_numbers(errors),
        }
    if "live" in steps:
        run(
            "run",
            folder / "model" / "model.json",
            "--device",
            bar,
            "--port",
            f"replay:{folder / 'twin'}",
            "--animation",
            folder / "live.npz",
            "--no-record",
            "--json",
        )
        # Frames are taken by the clock: the mesh of the surface is the same in each run, the times
        # and positions are not. The decoded markers are compared in the order of the recording.
        with np.load(folder / "live.npz") as data:
            results["live"] = {name: digest(data[name].tolist()) for name in ("faces", "rest")}
        results["live"]["markers"] = decode_markers(
            folder / "model" / "model.json", folder / "twin"
        )
    return results


def run(*words: object) -> str:
    """Run a command of `defsense` and return what it prints."""
    print("defsense", *words, file=sys.stderr)
    process = subprocess.run(
        [sys.executable, "-c", _MAIN, *map(str, words)], capture_output=True, text=True, check=False
    )
    if process.returncode:
        sys.exit(
            f"defsense {' '.join(map(str, words))}: exit {process.returncode}\n{process.stderr}"
        )
    return process.stdout


def decode_markers(model: Path, session: Path) -> str:
    """Return a digest of the markers that a model decodes from the samples of a session."""
    program = (
        "import sys, hashlib, defsense_fab as df\n"
        "model, data = df.Model.load(sys.argv[1]), df.load_sessions(sys.argv[2])\n"
        "r = data.recordings[0]\n"
        "found = model.predict(r.sample_time, r.ohm, r.rest)\n"
        "print(hashlib.sha256(found.tobytes()).hexdigest()[:16], *found.shape)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(model), str(session)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout.strip()


def describe_build(build: Path) -> dict[str, Any]:
    """Return the layout, prediction, volumes and file digests of a build."""
    layout = json.loads((build / "layout.json").read_text())
    manifest = json.loads((build / "parts/manifest.json").read_text())
    return {
        "unseen": layout["unseen"],
        "prediction": layout["prediction"]["unseen"],
        "band": [layout["band"][key] for key in ("low", "median", "high")],
        "lengths": {s["name"]: s["length"] for s in layout["sensors"]},
        "paths": digest([s["points"] for s in layout["sensors"]]),
        "layout": digest(numbers(layout)),
        "volumes": {p["name"]: p["volume"] for p in manifest["parts"]},
        "manifest": digest(numbers(manifest)),
        "files": digests(
            build, ("mesh.vtu", "parts/**/*.stl", "parts/**/*.step", "parts/**/*.3mf")
        ),
    }


def numbers(value: Any) -> list[float]:
    """Return all numbers of a JSON value in the order of its sorted keys."""
    if isinstance(value, dict):
        return [n for key in sorted(value) for n in numbers(value[key])]
    if isinstance(value, list):
        return [n for item in value for n in numbers(item)]
    return [float(value)] if isinstance(value, int | float) and not isinstance(value, bool) else []


def round_numbers(value: Any) -> Any:
    """Return a JSON value without its texts."""
    if isinstance(value, dict):
        expected_step = {key: round_numbers(value[key]) for key in value}
        return {key: item for key, item in expected_step.items() if item not in (None, {}, [])}
    if isinstance(value, list):
        return [round_numbers(item) for item in value if not isinstance(item, str)]
    return value if isinstance(value, int | float) else None


def digests(folder: Path, patterns: tuple[str, ...]) -> dict[str, str]:
    """Return the digest of each file that matches, by its path in the folder."""
    files = sorted({p for pattern in patterns for p in folder.glob(pattern)})
    return {p.relative_to(folder).as_posix(): file_digest(p) for p in files}


def file_digest(path: Path) -> str:
    """Return a digest of a file; of arrays in NPZ files, of their bytes."""
    if path.suffix == ".npz":
        with np.load(path) as data:
            return digest(
                [[name, hashlib.sha256(data[name].tobytes()).hexdigest()] for name in sorted(data)]
            )
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


def digest(value: Any) -> str:
    """Return the first 16 digits of the SHA-256 of a JSON value."""
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()[:16]


def compare(where: str, expected: Any, step_results: Any) -> list[str]:
    """List the differences of two JSON values, by their paths."""
    if isinstance(expected, dict) and isinstance(step_results, dict):
        keys = sorted({*expected, *step_results})
        return [
            line
            for key in keys
            for line in compare(f"{where}.{key}", expected.get(key), step_results.get(key))
        ]
    return (
        [] if expected == step_results else [f"{where}: expected {expected}, found {step_results}"]
    )


if __name__ == "__main__":
    sys.exit(main())
