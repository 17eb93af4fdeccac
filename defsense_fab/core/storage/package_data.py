"""Where files are that come with the package but are kept elsewhere in the repository, since people
look for them there. `setup.py` copies them into wheels, and reads this file alone for it."""

from __future__ import annotations

import csv
from importlib.resources import files
from pathlib import Path

# The tables in `data/`: materials, cords, printers; each row names its source.


def read_rows(file: str) -> dict[str, dict[str, str]]:
    """Rows of `data/<file>` by their `name` column."""
    text = (files("defsense_fab") / "data" / file).read_text(encoding="utf-8")
    return {row["name"]: row for row in csv.DictReader(text.splitlines())}


_PACKAGE = Path(__file__).resolve().parents[2]
#: Folders of `data/` in an installed package, and of what folder of the repository each is made.
IN_REPOSITORY = {
    "devices": "fixtures/devices",
    "examples": "examples",
    "firmware": "firmware",
}


def package_data(name: str) -> Path:
    """The folder of that name: the package's own where it is installed, else the repository's."""
    inside = _PACKAGE / "data" / name
    return inside if inside.is_dir() else _PACKAGE.parent / IN_REPOSITORY[name]
