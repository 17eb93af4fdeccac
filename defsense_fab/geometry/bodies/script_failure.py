"""What a body's script raised, as one sentence that its user can act on."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from ...core.errors import BodyError
from ...core.machine.optional_libraries import missing

_LONGEST = 300  # characters of a message; CAD kernels list every signature that they have
_SIGNATURES = re.compile(r"The following argument types are supported:.*?Invoked with:")
_ADDRESS = re.compile(r"<(?:\w+\.)*(\w+) object at 0x[0-9a-f]+>")


def script_failure(raised: Mapping[str, Any], parameters: Mapping[str, Any]) -> BodyError:
    """The error of a script that raised: `type`, `message`, and the `file` and `line` (or None)
    where it did; `parameters` are those that it was called with."""
    where = f"{raised['file']}:{raised['line']}" if raised["line"] else raised["file"]
    message = _plain(raised["message"])
    if raised["type"] == "SystemExit":
        said = f" ({message})" if message not in ("", "None") else ""
        return BodyError(
            f"{where}: the script ends the program{said} in place of returning a body; remove that"
            " call, or raise an error that says what is wrong",
            code="script-exits",
            line=raised["line"],
        )
    if raised.get("module"):
        return BodyError(
            _missing(where, str(raised["module"]), raised["type"], message),
            code="missing-library",
            line=raised["line"],
            module=raised["module"],
        )
    if not message:
        kernel = raised["type"].startswith(("Standard_", "StdFail_", "gp_"))
        message = "no message"
        if kernel:
            message = "the CAD kernel takes no size that is zero or negative, and no empty shape"
    given = ", ".join(f"{name} = {value}" for name, value in parameters.items())
    return BodyError(
        f"{where}: the script raised {raised['type']}: {message}; mend the script or its"
        f" parameters{f' ({given})' if given else ''}",
        code="script-raises",
        line=raised["line"],
        exception=raised["type"],
        message=message,
    )


def _missing(where: str, module: str, kind: str, message: str) -> str:
    """A library that is not installed, or does not load."""
    if kind != ModuleNotFoundError.__name__:
        return missing(where, ImportError(message, name=module))
    error = ModuleNotFoundError(name=module)
    if module.partition(".")[0] == "cadquery":
        return missing(where, error, "cadquery")
    return missing(where, error, otherwise="or put what the script imports into its folder")


def _plain(message: str) -> str:
    """Without the signatures and addresses that bindings of CAD kernels print."""
    text = _ADDRESS.sub(r"\1", _SIGNATURES.sub("It was given", message))
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."
