"""Libraries that are not installed everywhere: which is missing, for what, and what to type."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from ..errors import DefsenseError

PROJECT, CORE = "defsense-fab", "core"


def pip_install(*words: str) -> str:
    """The command that installs into the environment that runs. Double quotes serve all shells,
    cmd.exe among them, which takes single ones for a part of the name."""
    python = f'"{sys.executable}"' if " " in sys.executable else sys.executable
    quoted = [f'"{w}"' if set(w) & set(" []<>=!~,;") else w for w in words]
    return " ".join([python, "-m", "pip", "install", *quoted])


def missing(
    about: object, error: ImportError, extra: str = "", package: str = "", otherwise: str = ""
) -> str:
    """One line for an import that failed: `about` is what needs it. The `package` (that of the
    module where it is not named) is brought by an `extra` of this project, by the project itself
    (`CORE`), or alone; `otherwise` is another way out."""
    package = package or _package_of(error)
    more = f"; {otherwise}" if otherwise else ""
    more += "; defsense doctor tells more"
    if not isinstance(error, ModuleNotFoundError):  # it is there, and cannot be loaded
        why = " ".join(str(error).split())
        return f"{about}: needs the package {package}, whose import fails ({why}){more}"
    command = pip_install(_requirement(extra, package))
    return f"{about}: needs the package {package}, which is not installed; type: {command}{more}"


def _package_of(error: ImportError) -> str:
    return (error.name or "").partition(".")[0] or "a library"


def _requirement(extra: str, package: str) -> str:
    return {CORE: PROJECT, "": package}.get(extra, f"{PROJECT}[{extra}]")


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
    """Around imports. Raises an error of that `kind` where one fails, with the words of
    `missing`."""
    try:
        yield
    except ImportError as error:
        package = package or _package_of(error)
        raise kind(
            missing(about, error, extra, package, otherwise),
            code=missing_code(error),
            package=package,
            requirement=_requirement(extra, package),
        ) from None
