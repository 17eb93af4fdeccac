"""All checks of finished parts.

Every check returns its measurement; one that fails raises an error that names the cord or part and
the place (mm). The numbers come from the parts' facets and from samples of the channels, not from
the values that the parts were made with.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ....core.mesh import Surface
from ..check import Check
from ..records import Made, Rules
from .conservation import apart, volumes
from .insertion import insertion
from .sockets import sockets
from .thin_places import thin_places


def inspect(made: Made, pieces: Sequence[Any], body: Surface, rules: Rules) -> list[Check]:
    """All checks of the parts, whose manifold3d solids are `pieces`, of a `body`. Raises
    FabricationError for the first that fails."""
    return [
        volumes(made),
        apart(made),
        *sockets(made, body, rules),
        *thin_places(made, pieces, range(len(pieces)), rules),
        insertion(made, pieces, rules),
    ]
