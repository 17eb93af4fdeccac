"""Self-contained pages: Jinja templates of this folder, figures as data in the page."""

from __future__ import annotations

import base64
import io
from functools import cache
from pathlib import Path
from typing import Any

import jinja2

from ..core.storage.files import storage_errors, write_text


@cache
def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("defsense_fab", "report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )


def render(template: str, **values: Any) -> str:
    """The page `<template>.html` with `values` filled in, escaped. A value that the template names
    and that is not given raises jinja2.UndefinedError."""
    return _environment().get_template(f"{template}.html").render(**values)


def write_page(path: Path, template: str, **values: Any) -> None:
    """`render` to a file, whole or not at all. Raises StorageError."""
    with storage_errors(path):
        write_text(path, render(template, **values))


def as_image(figure: Any) -> str:
    """A matplotlib figure as a data URI for `<img src>`."""
    data = io.BytesIO()
    figure.savefig(data, format="png")
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode("ascii")
