"""Find data that comes with the package: tables in `data/`, and folders kept in the repository.

People look for devices, examples and the Arduino firmware at the repository's root, so they stay
there and `setup.py` copies them into wheels. It runs this file alone, which therefore imports no
other module of the package.
"""

from __future__ import annotations

import csv
from functools import cache
from importlib.resources import files
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[2]
#: Folders of `data/` in an installed package, and the folders of the repository they come from.
IN_REPOSITORY = {
    "devices": "fixtures/devices",
    "examples": "examples",
    "arduino": "firmware",
}


def package_data(name: str) -> Path:
    """Return a folder with package data.

    Args:
        name: A key of `IN_REPOSITORY`.

    Returns:
        The folder in the installed package, or else in the repository.
    """
    inside = _PACKAGE / "data" / name
    return inside if inside.is_dir() else _PACKAGE.parent / IN_REPOSITORY[name]


@cache
def read_rows(file: str) -> dict[str, dict[str, str]]:
    """Read a table in `data/`: materials, cords, printers. Each row names its source.

    Args:
        file: Name of a CSV file in `data/`.

    Returns:
        The rows by their `name` column, each with its cells by column; do not change them.
    """
    text = (files("defsense_fab") / "data" / file).read_text(encoding="utf-8")
    return {row["name"]: row for row in csv.DictReader(text.splitlines())}
