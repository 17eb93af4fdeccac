"""Render the 3D view as part of a page that opens from a file, without a network."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any

from markupsafe import Markup

from ..html import render
from .scene import Scene

#: Files of the script, in the order of their dependencies.
_SCRIPT = (
    "unpack.js", "keyframes.js", "color_maps.js", "tube.js", "camera.js", "followers.js",
    "stage.js", "panel.js", "main.js",
)  # fmt: skip


def view3d(scene: Scene) -> Markup:
    """Render the view of a scene, for one place in a page.

    Args:
        scene: Data of the view.

    Returns:
        HTML with style, library, script and data.
    """
    return Markup(  # noqa: S704  # the template escapes, the files are this package's
        render(
            "viewer/page/view",
            style=Markup(_text("page", "style.css")),  # noqa: S704
            library=Markup(_library()),  # noqa: S704
            script=Markup(_script()),  # noqa: S704
            told=Markup(in_script(scene.content)),  # noqa: S704
            numbers=scene.numbers,
        )
    )


def in_script(value: Any) -> str:
    """Return JSON that cannot end or open a tag inside `<script>`, whatever names it holds."""
    text = json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def _library() -> str:
    """Return three.js with its license, which every copy must carry."""
    return f"/*\n{_text('three', 'LICENSE')}*/\n{_text('three', 'three.min.js')}"


@cache
def _script() -> str:
    inner = "\n".join(_text("page", name) for name in _SCRIPT)
    return f'(() => {{\n"use strict";\n{inner}}})();'


def _text(*place: str) -> str:
    return files(__package__).joinpath(*place).read_text(encoding="utf-8")
