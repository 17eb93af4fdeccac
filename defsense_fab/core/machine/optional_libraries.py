"""Libraries that are not installed everywhere: which one is missing, and how to install it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from ..errors import DefsenseError

PROJECT, CORE = "defsense-fab", "core"


def pip_install(*requirements: str) -> str:
    """Return the command that installs packages into the running environment.

    Double quotes work in all shells; cmd.exe takes single quotes as part of the name.

    Args:
        *requirements: Packages, such as `numpy>=2`.
    """
    python = f'"{sys.executable}"' if " " in sys.executable else sys.executable
    quoted = [f'"{w}"' if set(w) & set(" []<>=!~,;") else w for w in requirements]
    return " ".join([python, "-m", "pip", "install", *quoted])


def missing(
    about: object, error: ImportError, extra: str = "", package: str = "", otherwise: str = ""
) -> str:
    """Describe an import that failed, in one line.

    Args:
        about: What needs the import, such as a file or a feature.
        error: The failure.
        extra: Extra of this project that installs the package, or `CORE` for the project itself;
            empty for a package that is installed alone.
        package: Package of the module, where it has another name.
        otherwise: Another way to reach the goal.

    Returns:
        What is missing, and the command that installs it.
    """
    problem, action = _describe(error, extra, package or _package_of(error), otherwise)
    return f"{about}: {problem}. {action}"


def missing_code(error: ImportError) -> str:
    """Return the error code of an import that failed."""
    if isinstance(error, ModuleNotFoundError):
        return "library-missing"
    return "library-broken"


@contextmanager
def optional(
    kind: type[DefsenseError],
    about: object,
    extra: str = "",
    package: str = "",
    otherwise: str = "",
) -> Iterator[None]:
    """Convert failures of the imports inside the block.

    Args:
        kind: Class of the error to raise.
        about: What needs the import, such as a file or a feature.
        extra: As in `missing`.
        package: As in `missing`.
        otherwise: As in `missing`.

    Raises:
        DefsenseError: Of the class `kind`, with the code `library-missing` or, where the library
            is installed but cannot be loaded, `library-broken`.
    """
    try:
        yield
    except ImportError as error:
        package = package or _package_of(error)
        problem, action = _describe(error, extra, package, otherwise)
        raise kind(
            problem,
            code=missing_code(error),
            where=about,
            action=action,
            package=package,
            requirement=_requirement(extra, package),
        ) from None


def _describe(error: ImportError, extra: str, package: str, otherwise: str) -> tuple[str, str]:
    """Return the problem and the action for an import that failed."""
    more = [otherwise] if otherwise else []
    more.append("run 'defsense doctor' for details")
    if not isinstance(error, ModuleNotFoundError):
        reason = " ".join(str(error).split())
        action = ", ".join(more)
        problem = f"needs the package {package}, which cannot be loaded ({reason})"
        return problem, action[:1].upper() + action[1:]
    command = pip_install(_requirement(extra, package))
    return (
        f"needs the package {package}, which is not installed",
        f"Type: {command} ({'; '.join(more)})",
    )


def _package_of(error: ImportError) -> str:
    return (error.name or "").partition(".")[0] or "a library"


def _requirement(extra: str, package: str) -> str:
    return {CORE: PROJECT, "": package}.get(extra, f"{PROJECT}[{extra}]")
