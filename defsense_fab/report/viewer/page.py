"""The view as a piece of a page: everything that it needs is inside, so that it opens from a file
without a network."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any

from markupsafe import Markup

from ..html import render
from .scene import Scene

#: The script, in the order in which its files need each other.
_SCRIPT = (
    "unpack.js", "keyframes.js", "color_maps.js", "tube.js", "camera.js", "followers.js",
    "stage.js", "panel.js", "main.js",
)  # fmt: skip


def view3d(scene: Scene) -> Markup:
    """The view of a scene, to be put into a page once."""
    return Markup(  # noqa: S704  # of the template below, which escapes, and of this package's files
        render(
            "viewer/page/view",
            style=Markup(_text("page", "style.css")),  # noqa: S704
            library=Markup(_library()),  # noqa: S704
            script=Markup(_script()),  # noqa: S704
            told=Markup(in_script(scene.told)),  # noqa: S704
            numbers=scene.numbers,
        )
    )


def in_script(value: Any) -> str:
    """JSON that nothing ends or opens inside `<script>`, whatever names are in it."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def _library() -> str:
    """three.js with its licence, which every copy has to carry."""
    return f"/*\n{_text('three', 'LICENSE')}*/\n{_text('three', 'three.min.js')}"


@cache
def _script() -> str:
    inner = "\n".join(_text("page", name) for name in _SCRIPT)
    return f'(() => {{\n"use strict";\n{inner}}})();'


def _text(*place: str) -> str:
    return files(__package__).joinpath(*place).read_text(encoding="utf-8")
