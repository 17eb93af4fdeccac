"""What a worker of a cluster does: plain values and bytes in, plain values and bytes out."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from ....core.errors import DefsenseError
from .batch import Batch, run_batch
from .pose_solves import solved
from .run_log import encoded
from .versions import difference, installed


def work_off(what: str, wanted: Mapping[str, str], *arguments: Any) -> dict[str, Any]:
    """The `result` of a "batch" of runs (their records as lines) or of a "pose" (its equilibria as
    bytes); `refused` in words where this machine's software is not as `wanted`, `failed` where it
    cannot work."""
    other = difference(wanted, installed())
    if other:
        return {"refused": f"has {other}"}
    try:
        return {"result": solved(*arguments) if what == "pose" else _records(*arguments)}
    except (DefsenseError, OSError, MemoryError) as error:
        return {"failed": str(error) or "its memory does not suffice"}


def _records(batch: str, files: bytes) -> list[str]:
    records = run_batch(msgspec.json.decode(batch, type=Batch), files)
    return [encoded(r) for r in records]


def travelling() -> tuple[Callable[..., dict[str, Any]], Callable[[], dict[str, str]]]:
    """`work_off` and `installed` as functions that are sent whole: neither the scheduler nor a
    worker needs this package to receive them, and a worker without it says so."""

    def work(what: str, wanted: dict[str, str], *arguments: Any) -> dict[str, Any]:
        try:
            from defsense_fab.workflow.study.runs.worker import work_off
        except ImportError as error:
            return {"refused": f"has no defsense-fab that works for others ({error})"}
        return work_off(what, wanted, *arguments)

    def versions() -> dict[str, str]:
        try:
            from defsense_fab.workflow.study.runs.versions import installed
        except ImportError:
            return {}
        return installed()

    return work, versions


def as_text(batch: Batch) -> str:
    """A batch as it is sent."""
    return json.dumps(msgspec.to_builtins(batch))
