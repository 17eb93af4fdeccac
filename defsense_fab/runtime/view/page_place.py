"""A place for a view on a page that shows other things, too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class PagePlace:
    """A viser `server`, and the `folder` of its panel in which a view has one of its own."""

    server: Any
    folder: Any
