"""Whether wheels of all that the package asks for exist for each system and Python.

    python -m venv /tmp/uv && /tmp/uv/bin/pip install uv
    python -m benchmarks.wheels --uv /tmp/uv/bin/uv [--lock] [--markdown]

uv resolves `pyproject.toml`, the core alone and with each extra, for systems that this machine is
not, with their environment markers, from the index that it is set up to use; wheels alone are
allowed and nothing is downloaded or run. What has no wheel is left out and told, and the rest is
resolved without it.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

SYSTEMS = {
    "Linux x86_64": "x86_64-manylinux_2_31",  # Ubuntu 20.04, Debian 11
    "Linux aarch64": "aarch64-manylinux_2_31",
    "Windows x86_64": "x86_64-pc-windows-msvc",
    "macOS arm64": "aarch64-apple-darwin",
    "macOS x86_64": "x86_64-apple-darwin",
}
MACOS = "15.0"
PYTHONS = ("3.11", "3.12", "3.13")
LACKING = re.compile(r"Wheels are (?:required|available) for `([A-Za-z0-9._-]+)`")
NONE = "no wheel"
MARKER = "; python_version < '3'"  # never: what is so overridden is left out


@dataclass(frozen=True)
class Resolution:
    """What one system gets: name -> (version, file, bytes), and what has no wheel."""

    wheels: dict[str, tuple[str, str, int]]
    lacking: tuple[str, ...]


def resolve(uv: str, source: Path, system: str, python: str, options: Iterable[str]) -> Resolution:
    """Raises SystemExit where uv fails for another reason than a wheel that is not there."""
    lacking: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        overrides, out = Path(folder, "overrides.txt"), Path(folder, "pylock.toml")
        while True:
            overrides.write_text("".join(f"{n}{MARKER}\n" for n in lacking), encoding="utf-8")
            run = subprocess.run(
                [uv, "pip", "compile", str(source), "--only-binary", ":all:", "--python-platform",
                 SYSTEMS[system], "--python-version", python, "--overrides", str(overrides),
                 "--format", "pylock.toml", "--output-file", str(out), "--no-header", "--quiet",
                 "--no-annotate", *options],
                capture_output=True, text=True, encoding="utf-8",
                env=os.environ | {"MACOSX_DEPLOYMENT_TARGET": MACOS},
            )  # fmt: skip
            if run.returncode == 0:
                return Resolution(_read(out), tuple(lacking))
            new = [n for n in LACKING.findall(run.stderr) if n not in lacking]
            if not new:
                sys.exit(f"{system}, Python {python}: uv says\n{run.stderr}")
            lacking += new


def _read(lock: Path) -> dict[str, tuple[str, str, int]]:
    packages = tomllib.loads(lock.read_text(encoding="utf-8")).get("packages", [])
    wheels = {}
    for package in packages:
        one = package["wheels"][-1]
        name = one.get("name") or one["url"].rpartition("/")[2]
        wheels[package["name"]] = (package["version"], name, one.get("size", 0))
    return wheels


def groups() -> dict[str, list[str]]:
    """The core, and the core with each extra, as uv's options."""
    about = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [e for e in about["optional-dependencies"] if e not in ("all", "dev")]
    return {"core": [], **{e: ["--extra", e] for e in extras}}


def table(rows: Iterable[Iterable[str]], markdown: bool) -> None:
    """The first row is the head."""
    rows = [list(r) for r in rows]
    if markdown:
        rows = [rows[0], ["---"] * len(rows[0]), *rows[1:]]
        print("\n".join(f"| {' | '.join(row)} |" for row in rows), end="\n\n")
        return
    width = [max(map(len, column)) for column in zip(*rows, strict=True)]
    print("\n".join("  ".join(c.ljust(w) for c, w in zip(r, width, strict=True)) for r in rows))
    print()


def whole(found: dict[tuple[str, str, str], Resolution], markdown: bool) -> None:
    """A row a group: on which Pythons all of it installs, and what lacks a wheel elsewhere."""
    rows = [["", *SYSTEMS]]
    for group in dict.fromkeys(g for g, _, _ in found):
        row = [group]
        for system in SYSTEMS:
            faults = defaultdict(list)
            for python in PYTHONS:
                faults[found[group, system, python].lacking].append(python)
            row.append("; ".join(
                ", ".join(pythons) + (f" without {', '.join(lacking)}" if lacking else "")
                for lacking, pythons in faults.items()
            ))  # fmt: skip
        rows.append(row)
    table(rows, markdown)


def packages(found: dict[tuple[str, str, str], Resolution], markdown: bool) -> None:
    """A row a package that is compiled and not the same everywhere; the others' names."""
    seen: dict[str, dict[str, dict[str, str]]] = defaultdict(lambda: defaultdict(dict))
    pure, of = set(), {}
    for (group, system, python), one in found.items():
        for name in one.lacking:
            seen[name][system][python] = NONE
            of.setdefault(name, group)
        for name, (version, file, _) in one.wheels.items():
            of.setdefault(name, group)
            if file.endswith("-any.whl"):
                pure.add(name)
            seen[name][system].setdefault(python, version)
    pure -= {n for n in pure if any(NONE in by.values() for by in seen[n].values())}
    rows, same = [["compiled", "of", *SYSTEMS]], []
    for name in sorted(set(seen) - pure):
        cells = [_cell(seen[name][system]) for system in SYSTEMS]
        if len(set(cells)) > 1 or NONE in cells[0]:
            rows.append([name, of[name], *cells])
        else:
            same.append(f"{name} {cells[0]}")
    table(rows, markdown)
    print(f"Compiled, and the same everywhere: {', '.join(same)}.\n")
    print(f"{len(pure)} more are pure Python, for every system.\n")


def _cell(versions: dict[str, str]) -> str:
    """The version; the Pythons of each, where they differ."""
    by = defaultdict(list)
    for python in PYTHONS:
        by[versions.get(python, "not needed")].append(python)
    if len(by) == 1:
        return next(iter(by))
    return "; ".join(f"{version} ({', '.join(pythons)})" for version, pythons in by.items())


def sizes(found: dict[tuple[str, str, str], Resolution], markdown: bool) -> None:
    """MB to download: the core's wheels, and what each extra adds."""
    python = PYTHONS[-1]
    rows = [[f"MB of wheels, Python {python}", *SYSTEMS]]
    for group in dict.fromkeys(g for g, _, _ in found):
        row = [group]
        for system in SYSTEMS:
            core = found["core", system, python].wheels if group != "core" else {}
            wheels = found[group, system, python].wheels
            row.append(f"{sum(w[2] for n, w in wheels.items() if n not in core) / 1e6:.0f}")
        rows.append(row)
    table(rows, markdown)


def main() -> None:
    """For the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--uv", default="uv", help="the program uv")
    parser.add_argument("--lock", action="store_true", help="requirements.lock, as make setup does")
    parser.add_argument("--markdown", action="store_true", help="tables for docs/platforms.md")
    arguments = parser.parse_args()
    asked = {"lock": ["--no-deps"]} if arguments.lock else groups()
    source = Path("requirements.lock" if arguments.lock else "pyproject.toml")
    found = {}
    for group, options in asked.items():
        for system in SYSTEMS:
            for python in PYTHONS:
                found[group, system, python] = resolve(
                    arguments.uv, source, system, python, options
                )
        print(f"{group} is resolved", file=sys.stderr)
    whole(found, arguments.markdown)
    if not arguments.lock:
        packages(found, arguments.markdown)
        sizes(found, arguments.markdown)


if __name__ == "__main__":
    main()
