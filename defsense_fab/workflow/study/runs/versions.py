"""The software that shapes the result of a run: the same must work wherever a study's runs are."""

from __future__ import annotations

import platform
from collections.abc import Mapping

from ....core.version import __version__
from ...build import stages


def installed() -> dict[str, str]:
    """Versions by name: the package, the number of its results, and the libraries of all stages
    that runs go to ("none" where one is not installed)."""
    python = ".".join(platform.python_version_tuple()[:2])
    found = {"defsense-fab": __version__, "its results": str(stages.CODE_VERSION), "Python": python}
    for stage, libraries in stages.installed_versions().items():
        if stage != "report":
            found |= {name: version or "none" for name, version in libraries}
    return found


def difference(wanted: Mapping[str, str], there: Mapping[str, str]) -> str | None:
    """The first version in which `there` is not as `wanted`, as a phrase; None where there is
    none."""
    for name, version in wanted.items():
        if there.get(name) != version:
            return f"{name} {there.get(name, 'none')} in place of {version}"
    return None
