"""What a worker of a cluster does with a batch: plain values in, plain values out."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from ....core.errors import DefsenseError
from .batch import Batch, run_batch
from .run_log import encoded
from .versions import difference, installed


def work_off(batch: str, files: bytes, wanted: Mapping[str, str]) -> dict[str, Any]:
    """The `records` of a batch, as lines; `refused` in words where this machine's software is not
    as `wanted`, `failed` where its disk does not let it work."""
    other = difference(wanted, installed())
    if other:
        return {"refused": f"has {other}"}
    try:
        records = run_batch(msgspec.json.decode(batch, type=Batch), files)
    except DefsenseError as error:
        return {"failed": str(error)}
    return {"records": [encoded(r) for r in records]}


def travelling() -> tuple[Callable[..., dict[str, Any]], Callable[[], dict[str, str]]]:
    """`work_off` and `installed` as functions that are sent whole: neither the scheduler nor a
    worker needs this package to receive them, and a worker without it says so."""

    def work(batch: str, files: bytes, wanted: dict[str, str]) -> dict[str, Any]:
        try:
            from defsense_fab.pipeline.study.runs.worker import work_off
        except ImportError as error:
            return {"refused": f"has no defsense-fab that runs studies ({error})"}
        return work_off(batch, files, wanted)

    def versions() -> dict[str, str]:
        try:
            from defsense_fab.pipeline.study.runs.versions import installed
        except ImportError:
            return {}
        return installed()

    return work, versions


def as_text(batch: Batch) -> str:
    """A batch as it is sent."""
    return json.dumps(msgspec.to_builtins(batch))
