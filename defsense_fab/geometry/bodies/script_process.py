"""A body's script in a process of its own: `python -m` this module, with a folder.

The folder holds `TASK`. The module leaves the solids in `SOLIDS` and, last, the files that the
script read, or its error, in `RESULT`.
"""

from __future__ import annotations

import json
import sys
import traceback
from pathlib import Path
from types import ModuleType
from typing import Any

from ...core.errors import BodyError
from ...core.storage.files import write_json
from .child_process import end_with_parent
from .source_files import OpenedFiles

TASK, SOLIDS, RESULT = "task.json", "solids.brep", "result.json"
_MISSING = object()


def main(folder: Path) -> None:
    """Run the script of the task, and write what came of it."""
    end_with_parent()
    task = json.loads((folder / TASK).read_text(encoding="utf-8"))
    path = Path(task["script"])
    opened = OpenedFiles(path.parent)
    sys.addaudithook(opened)
    outcome: dict[str, Any]
    try:
        result = _call(path, task["parameters"])
    except BaseException as error:  # scripts may raise anything, or call exit()
        frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        outcome = {
            "file": str(path),
            "line": frames[-1].lineno if frames else getattr(error, "lineno", None),
            "type": type(error).__name__,
            "message": " ".join(str(error).split()),
            "module": error.name if isinstance(error, ImportError) else None,
        }
    else:
        opened.active = False
        outcome = _save(result, folder / SOLIDS)
        outcome["sources"] = [[str(f.path), f.content] for f in opened.found.values()]
    write_json(folder / RESULT, outcome)


def _call(path: Path, parameters: dict[str, Any]) -> Any:
    """What `body(**parameters)` of the script returns, or `_MISSING`."""
    module = ModuleType("__body__")
    module.__file__ = str(path)
    sys.modules["__body__"] = module
    sys.path.insert(0, str(path.parent.absolute()))
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), vars(module))  # noqa: S102 - the user's own script
    body = getattr(module, "body", None)
    return body(**parameters) if callable(body) else _MISSING


def _save(result: Any, target: Path) -> dict[str, Any]:
    """Write the solids, or say why what the script returned has none."""
    if result is _MISSING:
        return {
            "refused": "defines no function body(...); add one that returns a solid",
            "code": "no-body-function",
            "data": {},
        }
    if result is None:
        return {
            "refused": "body() returned None; return the solid",
            "code": "not-a-solid",
            "data": {"type": "NoneType"},
        }
    from ..kernels import brep, occ

    try:
        brep.write_brep(occ.solids_of(result), target)
    except BodyError as error:
        return {"refused": str(error), "code": error.code, "data": error.data}
    return {}


if __name__ == "__main__":
    main(Path(sys.argv[1]))
