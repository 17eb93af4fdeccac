"""What the page says of a built device."""

from __future__ import annotations

import html

from ...report.guide.hands.steps import GuideStep
from ...report.guide.tables import GuideTable
from ..workbench.table_cell import table_cell

_WIDE = 5  # columns that the panel has room for


def step_words(step: GuideStep, number: int) -> str:
    """Markdown: the step as the guide has it."""
    return "\n".join(
        [f"### {number}. {table_cell(step.title)}", *(f"- {table_cell(x)}" for x in step.lines)]
    )


def table_words(table: GuideTable) -> str:
    """Markdown; a table of many columns is turned, so that each row of it is a column."""
    rows = [table.header, *table.rows]
    if not table.rows:
        return "nothing"
    if len(table.header) > _WIDE:
        rows = list(zip(*rows, strict=True))
    lines = ["| " + " | ".join(table_cell(x) for x in row) + " |" for row in rows]
    lines.insert(1, "|" + "---|" * len(rows[0]))
    return "\n".join(lines)


def state_words(built: bool, outdated: str | None, problem: str | None, otherwise: str = "") -> str:
    """Markdown: of which device the parts are. `outdated` is the title of the stage that has still
    to be done for the device as it is now, `problem` that of the last build; `otherwise` is what
    has changed on the plates since then or, of parts that are up to date, the options that they
    were asked for with."""
    failed = "" if problem is None else f" The last build did not end: {html.escape(problem)}."
    if not built:
        return f"**Nothing is built yet.**{failed} Press *Build everything*."
    if outdated is None:
        asked = (
            f" Their plates are as `{otherwise}` asked for; *Build everything* makes those of"
            " device.toml: state it there, under [fabrication], to keep it."
        )
        asked = asked if otherwise else ""
        return f"The parts are those of the device as it is now.{asked}"
    changed = f" ({otherwise})" if otherwise else ""
    return (
        f"**The parts are those of an older device**: since then it has changed{changed}, and"
        f" '{outdated}' has still to be done.{failed} Press *Build everything*; until then these"
        " stay."
    )
