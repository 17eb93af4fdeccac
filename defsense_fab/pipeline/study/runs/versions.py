"""The software that shapes the result of a run: the same must work wherever a study's runs are."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import metadata

from .... import __version__
from ...build.stages import CODE_VERSION, STAGES


def installed() -> dict[str, str]:
    """Versions by name: the package, the number of its results, and the libraries of all stages
    that runs go to ("none" where one is not installed)."""
    names = dict.fromkeys(n for s in STAGES if s.name != "report" for n in s.libraries)
    found = {"defsense-fab": __version__, "its results": str(CODE_VERSION)}
    return found | {name: _version(name) for name in names}


def difference(wanted: Mapping[str, str], there: Mapping[str, str]) -> str | None:
    """The first version in which `there` is not as `wanted`, as a phrase; None where there is
    none."""
    for name, version in wanted.items():
        if there.get(name) != version:
            return f"{name} {there.get(name, 'none')} in place of {version}"
    return None


def _version(library: str) -> str:
    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return "none"
