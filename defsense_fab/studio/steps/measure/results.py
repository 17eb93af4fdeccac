"""Results of checks, trainings, evaluations and fits as the page gets them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ....workflow.board.check import BoardCheck
from ...messages.measure import (
    ChannelFinding,
    CheckResult,
    DecoderResult,
    EvaluationResult,
    ResponseResult,
    TrainingResult,
)
from . import jobs


def check_result(check: BoardCheck, port: str) -> CheckResult:
    """Return the result of a check of the board at a port."""
    return CheckResult(
        port=port,
        is_sound=check.is_sound,
        is_complete=check.is_complete,
        findings=[
            ChannelFinding(
                channel=f.channel, cord=f.cord, code=f.code, text=f.text, action=f.action
            )
            for f in check.findings
        ],
        notes=[str(notice) for notice in check.notices],
        rate=check.sampling.rate,
        averages=check.sampling.averages,
        reference=list(check.reference),
    )


def training_result(
    path: str | Path, metadata: Mapping[str, Any], notes: tuple[str, ...] = ()
) -> TrainingResult:
    """Return the result of a training from the metadata of its model."""
    images = metadata.get("pictures")
    counts = images if isinstance(images, Mapping) else {}
    return TrainingResult(
        model=Path(path).name,
        decoders=[_decoder(row, metadata) for row in metadata.get("candidates") or ()],
        trained_images=counts.get("trained"),
        tested_images=counts.get("tested"),
        trained_on=str(metadata.get("trained_on", "")),
        warning=usefulness_warning(metadata),
        notes=list(notes),
    )


def evaluation_result(result: jobs.EvaluationResult, model: str) -> EvaluationResult:
    """Return the result of an evaluation of a model."""
    total = result.total
    return EvaluationResult(
        model=model,
        rmse=total.rmse,
        deviation=total.deviation,
        peak=total.peak,
        average_peak=total.average_peak,
        frames=total.frames,
        notes=list(result.notes),
    )


def response_result(data: Mapping[str, Any], *, is_simulated: bool) -> ResponseResult:
    """Return a fitted response from the content of its file."""
    return ResponseResult(
        k_res=float(data["k_res"]),
        interval=[float(x) for x in data["interval"]],
        reason=str(data["reason"]),
        strains=[float(x) for x in data["strain_range"]],
        readings=int(data["readings"]),
        pieces=len(data["pieces"]),
        warnings=[str(w) for w in data["warnings"]],
        is_simulated=is_simulated,
        can_use=True,
    )


def test_error(metadata: Mapping[str, Any]) -> float | None:
    """Return the test error of the chosen decoder, mm (RMSE); None if it was not tested."""
    for row in metadata.get("candidates") or ():
        test = row.get("test")
        if row["decoder"] == metadata.get("decoder") and test is not None:
            return float(test["rmse"])
    return None


def usefulness_warning(metadata: Mapping[str, Any]) -> str:
    """Return why the test found a model useless; empty for a useful one."""
    message = str((metadata.get("usefulness") or {}).get("message") or "")
    return message[:1].upper() + message[1:]


def _decoder(row: Mapping[str, Any], metadata: Mapping[str, Any]) -> DecoderResult:
    test = row.get("test")
    return DecoderResult(
        decoder=str(row["decoder"]),
        folds=float(row["cross_validated"]),
        test=None if test is None else float(test["rmse"]),
        peak=None if test is None else float(test["peak"]),
        is_chosen=row["decoder"] == metadata.get("decoder"),
    )
