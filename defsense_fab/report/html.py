"""Render self-contained HTML pages from this folder's Jinja templates."""

from __future__ import annotations

import base64
import io
from functools import cache
from pathlib import Path
from typing import Any

import jinja2

from ..core.storage.files import storage_errors, write_text


@cache
def environment() -> jinja2.Environment:
    """Return the environment of this folder's templates; it escapes values in HTML only."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader("defsense_fab", "report"),
        autoescape=jinja2.select_autoescape(),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )


def render(template: str, **values: Any) -> str:
    """Render a template with escaped values.

    Args:
        template: Name of the template, without `.html`.
        values: Values that the template uses.

    Returns:
        The page.

    Raises:
        jinja2.UndefinedError: A value that the template uses is missing.
    """
    return environment().get_template(f"{template}.html").render(**values)


def write_page(path: Path, template: str, **values: Any) -> None:
    """Render a template to a file, completely or not at all.

    Args:
        path: The file to write.
        template: Name of the template, without `.html`.
        values: Values that the template uses.

    Raises:
        StorageError: The file cannot be written.
    """
    with storage_errors(path):
        write_text(path, render(template, **values))


def as_svg_image(svg: str) -> str:
    """Return the text of an SVG file as a data URI."""
    return "data:image/svg+xml;base64," + base64.b64encode(svg.encode("utf-8")).decode("ascii")


def as_image(figure: Any) -> str:
    """Return a matplotlib figure as a PNG data URI."""
    data = io.BytesIO()
    figure.savefig(data, format="png")
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode("ascii")
