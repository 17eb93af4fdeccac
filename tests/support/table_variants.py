"""Random forms of one table, as spreadsheets and programs write it, with its true numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252")
_NAMES = ("time", "left_ohm", "Mitte", "größe µ", "x y", "Right", "n")
_THOUSANDS = (".", ",", " ", "\u202f", "\u00a0", "'")


@dataclass(frozen=True)
class TableVariant:
    """A table in one form.

    Attributes:
        content: Bytes of the file.
        names: Names of the k columns.
        values: Its numbers (n, k); NaN for empty cells.
        code: Error that reading it must raise; empty if it is valid.
        line: Line that the error must name.
        column: Column that the error must name.
    """

    content: bytes
    names: tuple[str, ...]
    values: np.ndarray
    code: str = ""
    line: int = 0
    column: str = ""

    @property
    def is_readable(self) -> bool:
        """Whether the table is valid."""
        return not self.code


def random_variant(rng: np.random.Generator) -> TableVariant:
    """Return a table with random numbers in a random form."""
    separator = str(rng.choice([",", ";", "\t"]))
    decimal = "," if rng.random() < 0.5 else "."
    quotes = str(rng.choice(["none", "all", "some"]))
    if separator == "," and decimal == ",":
        quotes = "all"
    encoding = str(rng.choice(_ENCODINGS))
    end = str(rng.choice(["\n", "\r\n", "\r"]))
    names = tuple(rng.permutation(_NAMES)[: rng.integers(2, len(_NAMES) + 1)].tolist())
    texts = [[_number(rng) for _ in names] for _ in range(rng.integers(1, 30))]
    values = np.array([[float(t) if t else np.nan for t in row] for row in texts])
    bad, code = None, ""
    if rng.random() < 0.25:
        bad = int(rng.integers(len(texts))), int(rng.integers(len(names)))
        code, texts[bad[0]][bad[1]] = _bad_cell(rng, separator, decimal)
        if code == "decimal-signs-mixed":
            texts = [
                [t if (i, k) == bad else "1.5" for k, t in enumerate(row)]
                for i, row in enumerate(texts)
            ]
            bad = len(texts), 0
            texts.append(["2" + ("." if decimal == "," else ",") + "25", *["1"] * (len(names) - 1)])

    def cell(text: str, is_number: bool, is_bad: bool) -> str:
        if is_number and not is_bad:
            text = text.replace(".", decimal)
        pad = " " * int(rng.integers(0, 3)) if rng.random() < 0.1 else ""
        is_quoted = (
            quotes == "all" or (quotes == "some" and rng.random() < 0.3) or separator in text
        )
        return pad + (f'"{text}"' if is_quoted else text)

    lines = []
    if rng.random() < 0.2:
        lines.append(f"sep={separator}")
    if rng.random() < 0.2:
        lines.append("# measured on Tuesday; with 2,5 mm")
    lines.append(separator.join(cell(name, False, False) for name in names))
    trailing = separator * int(rng.integers(0, 3)) if rng.random() < 0.2 else ""
    bad_line = 0
    for i, row in enumerate(texts):
        while rng.random() < 0.1:
            lines.append(str(rng.choice(["", "  ", separator * (len(names) - 1)])))
        if not any(row):
            row[0] = "0"
            values[i, 0] = 0.0
        is_bad = [bad == (i, k) for k in range(len(names))]
        lines.append(
            separator.join(cell(t, True, b) for t, b in zip(row, is_bad, strict=True)) + trailing
        )
        bad_line = len(lines) if any(is_bad) else bad_line
    text = end.join(lines) + (end if rng.random() < 0.8 else "")
    column = names[bad[1]] if bad else ""
    if encoding == "cp1252" and "\u202f" in text:
        encoding = "utf-8"
    return TableVariant(text.encode(encoding), names, values, code, bad_line, column)


def _number(rng: np.random.Generator) -> str:
    """Return a number with a decimal point, or an empty cell.

    One decimal or more than three, as 2,231 in a table with commas is refused.
    """
    kind = rng.integers(6)
    value = float(rng.normal() * 10.0 ** rng.integers(-3, 5))
    if kind == 0:
        return ""
    if kind == 1:
        return str(round(value))
    if kind == 2:
        return f"{value:.6e}"
    return f"{value:.{rng.choice([1, 2, 4, 9])}f}"


def _bad_cell(rng: np.random.Generator, separator: str, decimal: str) -> tuple[str, str]:
    """Return an error's code and a cell that causes it."""
    kind = rng.integers(3)
    if kind == 0:
        return "not-a-number", str(
            rng.choice(["abc", "12 Ohm", "1.2.3", "1,2,3", "--5", "1e", "2k"])
        )
    if kind == 1:
        grouping = str(rng.choice([t for t in _THOUSANDS if t != decimal]))
        return "not-a-number", f"2{grouping}231{decimal}5"
    return "decimal-signs-mixed", "1.5"
