"""Read tables in text, as spreadsheets and programs of others write them.

Columns are separated by commas, semicolons or tabs, or as a first line `sep=;` states. The text is
in UTF-8, UTF-16 or cp1252. Numbers have decimal points, or decimal commas throughout. Numbers with
separators of thousands are refused, as 2,231 may mean either 2.231 or 2231.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Float
from ..errors import DefsenseError
from .files import unreadable_code
from .text import decode_text, parse_numbers

_SEPARATORS = ",;\t"
_SEPARATOR_LINE = re.compile(r'"?sep=(.)"?\s*\n', re.IGNORECASE)
_COMMENT = "#"
_QUOTED = re.compile(r'"[^"]*"')
_WORKBOOKS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")  # .xlsx and .ods, .xls
_BLOCK_ROWS = 10_000
MIN_ROWS_BEFORE_CUT, MAX_ROWS_BEFORE_CUT = 3, 100  # whose decimals are compared
_MAX_SHOWN = 40  # characters of a cell in a message
_COMMA_NUMBER = re.compile(r"[+-]?[0-9]*,[0-9]*(?:[eE][+-]?[0-9]+)?")
_GROUPED_COMMA = re.compile(r"[+-]?[0-9]{1,3},[0-9]{3}")
#: A number with separators of thousands, with or without decimals.
_GROUPED = re.compile(r"[+-]?[0-9]{1,3}(?:[.,'\u2019\s\u00a0\u202f][0-9]{3})+(?:[.,][0-9]*)?")
_HAS_DIGIT = re.compile(r"[0-9]")
_POINT, _COMMA = "point", "comma"


class Row(NamedTuple):
    """A row of a table.

    Attributes:
        line: Number of its line in the file, from 1.
        cells: Text of the cells, without spaces around it.
    """

    line: int
    cells: list[str]


@dataclass
class DelimitedTable:
    """A table in text.

    Attributes:
        source: Name of the file, for messages.
        names: Names of the columns; empty for columns without a name.
        header_line: Number of the line that names the columns.
        separator: Character between columns.
        ends_with_newline: Whether the last line has its end.
        error: Class of the errors to raise.
    """

    source: str
    names: tuple[str, ...]
    header_line: int
    separator: str
    ends_with_newline: bool
    error: type[DefsenseError]
    _rows: Iterator[Row]
    _decimal: dict[str, tuple[int, str]] = field(default_factory=dict)

    def place(self, line: int) -> str:
        """Return the name of a line, for messages."""
        return f"{self.source}:{line}"

    def rename(self, names: Sequence[str]) -> None:
        """Give the columns other names.

        Raises:
            DefsenseError: If two of them are equal.
        """
        repeated = [n for n, count in Counter(names).items() if n and count > 1]
        if repeated:
            raise self.error(
                f"the column {repeated[0]} appears twice",
                code="column-repeated",
                where=self.place(self.header_line),
                action="Rename or delete one of them",
                column=repeated[0],
            )
        self.names = tuple(names)

    def rows(self) -> Iterator[Row]:
        """Iterate once over the rows below the header; blank rows and comments are skipped.

        Raises:
            DefsenseError: If a quotation mark is not closed, or a row has too many cells.
        """
        count = len(self.names)
        for row in self._rows:
            if len(row.cells) > count:
                if any(row.cells[count:]):
                    raise self.error(
                        f"there are {len(row.cells)} cells in {count} columns",
                        code="too-many-cells",
                        where=self.place(row.line),
                        action="Separate columns by semicolons if numbers have decimal commas",
                        line=row.line,
                    )
                del row.cells[count:]
            yield row

    def blocks(self) -> Iterator[list[Row]]:
        """Iterate over the rows in blocks, to convert columns of long tables at once."""
        rows = self.rows()
        while block := list(islice(rows, _BLOCK_ROWS)):
            yield block

    def numbers(self, cells: Sequence[str], lines: Sequence[int], column: str) -> Float:
        """Convert cells of a column.

        Args:
            cells: Text of n cells; empty ones become NaN.
            lines: Their lines.
            column: Name of the column, for messages.

        Returns:
            Numbers (n,).

        Raises:
            DefsenseError: If a cell is not a number, has separators of thousands, or has a decimal
                comma where an earlier cell has a point.
        """
        has_point = any("." in cell for cell in cells)
        if not has_point or _COMMA not in self._decimal:
            try:
                values = parse_numbers(cells)
            except ValueError:
                pass
            else:
                if has_point and _POINT not in self._decimal:
                    k = next(k for k, cell in enumerate(cells) if "." in cell)
                    self._decimal[_POINT] = lines[k], cells[k]
                return values
        pairs = zip(cells, lines, strict=True)
        return np.array([self.number(c, line, column) if c else np.nan for c, line in pairs], float)

    def number(self, cell: str, line: int, column: str) -> float:
        """Convert one cell; see `numbers`."""
        is_comma = bool(_COMMA_NUMBER.fullmatch(cell))
        try:
            value = float(parse_numbers([cell.replace(",", ".") if is_comma else cell])[0])
        except ValueError:
            value = None
        if value is None or (is_comma and self.separator == "," and _GROUPED_COMMA.fullmatch(cell)):
            raise self._not_a_number(cell, line, column)
        kind = _COMMA if is_comma else _POINT if "." in cell else ""
        other_kind = {_COMMA: _POINT, _POINT: _COMMA}.get(kind, "")
        if other_kind in self._decimal:
            other_line, other = self._decimal[other_kind]
            raise self.error(
                f"{_show(cell)} has a decimal {kind}, but {_show(other)} in line"
                f" {other_line} has a {other_kind}",
                code="decimal-signs-mixed",
                where=f"{self.place(line)}: {column}",
                action="Write all numbers with the same decimal sign",
                place=self.place(line),
                line=line,
                column=column,
                value=cell[:_MAX_SHOWN],
            )
        if kind:
            self._decimal.setdefault(kind, (line, cell))
        return value

    def _not_a_number(self, cell: str, line: int, column: str) -> DefsenseError:
        is_grouped = bool(_GROUPED.fullmatch(cell))
        problem = "seems to have separators of thousands" if is_grouped else "is not a number"
        action = "Write numbers without them" if is_grouped else "Write a number without a unit"
        return self.error(
            f"{_show(cell)} {problem}",
            code="not-a-number",
            where=f"{self.place(line)}: {column}",
            action=action,
            place=self.place(line),
            line=line,
            column=column,
            value=cell[:_MAX_SHOWN],
        )


def _show(cell: str) -> str:
    """Return the text of a cell for a message, with ordinary spaces."""
    return repr(" ".join(cell.split())[:_MAX_SHOWN])


def read_delimited(
    path: Path, error: type[DefsenseError], source: str | None = None
) -> DelimitedTable:
    """Read a table in text whose first row names the columns.

    Lines that start with `#` are comments.

    Args:
        path: The file.
        error: Class of the errors to raise.
        source: Name of the file in messages; by default its path.

    Returns:
        The table; its rows are read as they are iterated.

    Raises:
        DefsenseError: Of the class `error`, if the file cannot be read, is not text or is empty, or
            if two columns have the same name.
    """
    text = _read_text(path, error)
    stated = _SEPARATOR_LINE.match(text)
    separator = stated[1] if stated else _find_separator(text)
    table = DelimitedTable(
        str(path) if source is None else source,
        (),
        0,
        separator,
        text.endswith("\n"),
        error,
        iter(()),
    )
    table._rows = _iterate_rows(table, text, skip=1 if stated else 0)
    header = next(table._rows, None)
    if header is None:
        raise error(
            "is empty",
            code="file-empty",
            where=path,
            action="Name the columns in the first line",
        )
    names = header.cells
    while names and not names[-1]:
        names.pop()
    table.header_line = header.line
    table.rename(names)
    return table


def is_cut_off(last: Sequence[str], earlier: Sequence[Sequence[str]], columns: int) -> bool:
    """Return whether a last row, whose line has no end, is cut off.

    It is if it has too few cells, or if its last cell is empty, is not a number, or has fewer
    decimals, as in none of the earlier rows, of which there are at least three.

    Args:
        last: Cells of the row.
        earlier: Cells of up to MAX_ROWS_BEFORE_CUT rows before it.
        columns: Number of the columns.
    """
    if len(last) < columns:
        return True
    above = [row[columns - 1] for row in earlier if len(row) >= columns]
    if len(above) < MIN_ROWS_BEFORE_CUT:
        return False
    if not _is_number(last[-1]):
        return last[-1] not in above
    numbers = [cell for cell in above if _HAS_DIGIT.search(cell)]
    return bool(numbers) and _count_decimals(last[-1]) < min(map(_count_decimals, numbers))


def cut_note(path: Path, line: int) -> str:
    """Return the note on a last row that is left out because it is cut off."""
    return f"{path.name}: the last line ({line}) is cut off, and left out"


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def _count_decimals(cell: str) -> int:
    sign = max(cell.rfind("."), cell.rfind(","))
    return len(cell) - 1 - sign if sign >= 0 else 0


def _read_text(path: Path, error: type[DefsenseError]) -> str:
    """Return the text of a file with line feeds as line ends."""
    try:
        data = path.read_bytes()
    except OSError as problem:
        raise error(
            f"cannot be read: {problem.strerror}",
            code=unreadable_code(problem),
            where=path,
            action="Check the path and its permissions",
            path=path,
        ) from None
    is_workbook = data.startswith(_WORKBOOKS)
    text = decode_text(data)
    if is_workbook or "\0" in text:
        raise error(
            "is a workbook, not text" if is_workbook else "is not text",
            code="not-text",
            where=path,
            action="Save the table as CSV",
            path=path,
        )
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _find_separator(text: str) -> str:
    """Return the most frequent separator of the first row, outside quotation marks."""
    lines = (line for line in text.split("\n", 100) if line.strip())
    first = next((line for line in lines if not line.lstrip().startswith(_COMMENT)), "")
    return max(_SEPARATORS, key=_QUOTED.sub("", first).count)


def _iterate_rows(table: DelimitedTable, text: str, skip: int) -> Iterator[Row]:
    """Iterate over rows that are neither blank nor comments, with the lines in which they start."""
    reader: Any = csv.reader(io.StringIO(text), delimiter=table.separator, skipinitialspace=True)
    last_line = text.count("\n") + (not text.endswith("\n"))
    has_odd_quote = text.count('"') % 2 == 1

    def unclosed(line: int) -> DefsenseError:
        return table.error(
            "a quotation mark is not closed",
            code="quote-unclosed",
            where=table.place(line),
            action="Close or delete it",
            line=line,
        )

    while True:
        line = reader.line_num + 1
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error:  # a cell longer than any real one
            raise unclosed(line) from None
        if has_odd_quote and line < reader.line_num == last_line and "\n" in cells[-1]:
            raise unclosed(line)
        cells = [cell.strip() for cell in cells]
        if line > skip and any(cells) and not cells[0].startswith(_COMMENT):
            yield Row(line, cells)
