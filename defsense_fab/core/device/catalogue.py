"""The tables in `data/`: materials, cords, printers; each row names its source."""

from __future__ import annotations

import csv
from importlib.resources import files


def read_rows(file: str) -> dict[str, dict[str, str]]:
    """Rows of `data/<file>` by their `name` column."""
    text = (files("defsense_fab") / "data" / file).read_text(encoding="utf-8")
    return {row["name"]: row for row in csv.DictReader(text.splitlines())}
