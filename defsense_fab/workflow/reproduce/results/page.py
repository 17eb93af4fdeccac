"""The page of all experiments, with rounded numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ....core.version import __version__
from ....report import html
from ..experiments.experiment import AFFINE, PREDICTED, TOLD_APART

QUANTITY_LABELS = {
    "rmse": "RMSE, mm",
    "peak": "peak, mm",
    "average_peak": "average peak, mm",
    PREDICTED: "predicted RMSE, mm",
    TOLD_APART: "poses recognized",
    "k_res": "slope k_res",
    "interval": "share of 95 % intervals that contain the truth",
    "hysteresis": "hysteresis, relative to the largest signal",
    "repeatability": "difference of two passes, relative to the largest signal",
}
#: Largest share of the total error in a split by cause that is shown.
MAX_CAUSE_SHARE = 3.0
SHARE_QUANTITIES = {TOLD_APART, "interval", "hysteresis", "repeatability"}


def write_page(path: Path, data: Mapping[str, Any]) -> None:
    """Write the results of `run.reproduce` as one page that needs no other file.

    Raises:
        StorageError: The page cannot be written.
    """
    experiments = [_experiment(e) for e in data["experiments"]]
    html.write_page(
        path, "reproduction", experiments=experiments, quick=data["quick"], version=__version__
    )


def _experiment(e: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of the page for an experiment."""
    page: dict[str, Any] = {
        **{k: e[k] for k in ("name", "title", "figures", "about", "session")},
        "numbers": [format_number(row) for row in e["numbers"]],
        "layouts": [], "pictures": e.get("pictures"), "assumptions": e.get("assumptions", ()),
        "cords": e.get("cords"), "truth": e.get("truth"), "causes": None, "rebuilt": None,
        "told_apart": None,
    }  # fmt: skip
    if "layouts" in e:
        titles = {c["name"]: c["title"] for c in e["choices"]}
        page["layouts"] = [
            _layout(name, titles[name], results) for name, results in e["layouts"].items()
        ]
        page["causes"] = _causes(e["layouts"])
        page["rebuilt"] = _simulated_causes(e["layouts"])
        page["told_apart"] = _pose_recognition(e["layouts"])
        page["twin"] = next(iter(e["layouts"].values()))["units"][0]["twin"]
    return page


def format_number(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row of an experiment's numbers as text."""
    is_share = row["quantity"] in SHARE_QUANTITIES and row["over"] is None
    label = QUANTITY_LABELS[row["quantity"]]
    if row["over"] is not None:
        label = f"{row['of']} / {row['over']}: {label.removesuffix(', mm')}, times"
    else:
        label = f"{row['of']}: {label}"
    if row["decoder"] == AFFINE:
        label += ", affine decoder"
    expected = ""
    if row["at_most"] is not None:
        expected = f"at most {_text(row['at_most'], is_share)}"
    if row["at_least"] is not None:
        expected = f"at least {_text(row['at_least'], is_share)}"
    ours, spread, values = "not measured", "", row["values"]
    if row["ours"] is not None:
        ours = _text(row["ours"], is_share)
        if len(values) > 1:
            ours += f" ± {_text(row['sd'], is_share)}"
            spread = f"{_text(min(values), is_share)} to {_text(max(values), is_share)}"
    return {
        "what": label, "ours": ours, "expected": expected, "where": row["where"], "why": row["why"],
        "paper": "" if row["paper"] is None else _text(row["paper"], is_share),
        "ratio": "" if row["ratio"] is None else f"{row['ratio']:.2f}",
        "met": {None: "", True: "met", False: "not met"}[row["met"]],
        "spread": spread,
    }  # fmt: skip


def _text(value: float, is_share: bool = False) -> str:
    return f"{100 * value:.3g} %" if is_share else f"{value:.2f}"


def _layout(name: str, title: str, results: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of the page for a layout."""
    design, units = results["design"], results["units"]
    predicted = [u["predicted"]["promised_ratio"] for u in units if u["predicted"] is not None]
    movement = {k: [u["movement"][k] for u in units] for k in (AFFINE, "chosen")}
    return {
        "name": name, "title": title, "cords": design["cords"], "design": design,
        AFFINE: _errors([u[AFFINE] for u in units]),
        "chosen": _errors([u["chosen"] for u in units]),
        "truth": _errors([u["truth"] for u in units]),
        "decoders": ", ".join(dict.fromkeys(u["decoder"] for u in units)),
        "tested": units[0]["frames"]["tested"], "markers": units[0]["markers"],
        "left_out": sorted({n for u in units for n in u["left_out"]}),
        "movement": {
            k: {
                "design": _mean([m["design"] for m in rows]),
                "rmse": _mean([m["rmse"] for m in rows]),
                "ratio": _range([m["ratio"] for m in rows]),
            }
            for k, rows in movement.items()
        },
        "promised": _range([p for p in predicted if p]),
    }  # fmt: skip


def _errors(rows: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    """Return means over units, and the range of their RMSE."""
    errors: dict[str, Any] = {k: _mean([r[k] for r in rows]) for k in rows[0]}
    errors["range"] = _range([r["rmse"] for r in rows])
    return errors


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _range(values: Sequence[float]) -> str:
    if not values:
        return ""
    low, high = min(values), max(values)
    return f"{low:.2f}" if len(values) == 1 else f"{low:.2f} to {high:.2f}"


def _causes(layouts: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return tables of the causes' shares of the mean square error by layout, means over units.

    One table is fitted to the recordings, the other one uses the truth of the twin.
    """
    tables = []
    for key, title in (
        ("causes", "estimated from the recording alone"),
        ("causes_by_truth", "computed by removing them from the twin's recording"),
    ):
        budgets = {
            n: [u[key] for u in f["units"] if u[key] is not None] for n, f in layouts.items()
        }
        budgets = {n: some for n, some in budgets.items() if some}
        if not budgets:
            continue
        names = dict.fromkeys(
            c for some in budgets.values() for one in some for c in one if c != "total"
        )
        # A decoder of signals without information amplifies noise beyond all measured errors.
        implausible = [
            n
            for n, some in budgets.items()
            if any(abs(v) > MAX_CAUSE_SHARE * one["total"] for one in some for v in one.values())
        ]
        budgets = {n: some for n, some in budgets.items() if n not in implausible}
        rows = [
            (cause, [_share(some, cause) for some in budgets.values()])
            for cause in names
        ]  # fmt: skip
        tables.append({"title": title, "layouts": list(budgets), "rows": rows, "wild": implausible})
    return tables


def _share(budgets: Sequence[Mapping[str, float]], cause: str) -> str:
    shares = [100 * b.get(cause, 0.0) / b["total"] for b in budgets if b["total"]]
    return f"{np.mean(shares):.0f} %" if shares else ""


def _simulated_causes(layouts: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the errors of the layout that was simulated without one cause after another.

    They are RMSE in mm, and the share of the mean square error of each cause. The error without
    any cause is that of the decoder and the poses.
    """
    for name, results in layouts.items():
        c = results.get("causes")
        if c is not None:
            total = c["all"] ** 2
            rows = [
                (cause, f"{rmse:.2f}", f"{100 * (total - rmse**2) / total:.0f} %")
                for cause, rmse in c["without"].items()
            ]
            none, remaining = c["without_all"], c["without_all"] ** 2 / total
            return {"layout": name, "all": f"{c['all']:.2f}", "rows": rows, "none": f"{none:.2f}",
                    "left": f"{100 * remaining:.0f} %"}  # fmt: skip
    return None


def _pose_recognition(layouts: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return by layout the share of frames whose pose is recognized, over all units."""
    recognition = {}
    for name, results in layouts.items():
        tests = [u["told_apart"] for u in results["units"] if u["told_apart"] is not None]
        if tests:
            poses = dict.fromkeys(p for t in tests for p in t["by_pose"])
            recognition[name] = {
                "share": _text(float(np.mean([t["share"] for t in tests])), True),
                "frames": sum(t["frames"] for t in tests),
                "poses": {
                    p: _text(float(np.mean([t["by_pose"][p] for t in tests if p in t["by_pose"]])),
                             True)
                    for p in poses
                },
            }  # fmt: skip
    return recognition or None
