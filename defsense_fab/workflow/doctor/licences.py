"""Licences of the installed libraries, as their metadata has them."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import metadata

from ...core.errors import StorageError
from ...core.machine.optional_libraries import PROJECT

UNKNOWN = "not told by its metadata"


@dataclass(frozen=True)
class Licence:
    """Of a distribution."""

    name: str
    version: str
    licence: str


def installed_licences() -> list[Licence]:
    """Of the project's dependencies, with all extras but `dev`, and of theirs in turn, where they
    are installed; by name. Raises StorageError where the project is not installed as a package."""
    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    todo: list[tuple[str, tuple[str, ...]]] = [(PROJECT, ("",))]
    extras: dict[str, set[str]] = {}
    found: dict[str, Licence] = {}
    while todo:
        name, asked = todo.pop()
        key = str(canonicalize_name(name))
        new = set(asked) - extras.get(key, set())
        if not new:
            continue
        extras.setdefault(key, set()).update(new)
        try:
            about = metadata.distribution(name)
        except metadata.PackageNotFoundError:
            if name == PROJECT:
                raise StorageError(
                    f"{PROJECT} is not installed as a package: pip install it, then its"
                    " dependencies are known"
                ) from None
            continue
        if name == PROJECT:
            new |= {e for e in about.metadata.get_all("Provides-Extra") or () if e != "dev"}
        else:
            found[key] = Licence(about.name, about.version, licence_of(about.metadata))
        todo += [
            (one.name, ("", *one.extras))
            for one in map(Requirement, about.requires or ())
            if one.marker is None or any(one.marker.evaluate({"extra": e}) for e in new)
        ]
    return [found[key] for key in sorted(found)]


def licence_of(about: metadata.PackageMetadata) -> str:
    """License-Expression, else the classifiers', else the first line of License."""
    if expression := about.get_all("License-Expression"):
        return str(expression[0])
    classifiers = [
        c.rpartition(" :: ")[2]
        for c in about.get_all("Classifier") or ()
        if c.startswith("License :: ") and c != "License :: OSI Approved"
    ]
    if classifiers:
        return ", ".join(classifiers)
    text = str((about.get_all("License") or [""])[0]).strip()
    return text.splitlines()[0] if text else UNKNOWN
