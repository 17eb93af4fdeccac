"""The paper's numbers and ours: comparison, and the page of all experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...core.version import __version__
from ...report import html
from .experiment import AFFINE, PREDICTED, RECOGNIZED, PaperNumber

QUANTITY_LABELS = {
    "rmse": "RMSE, mm",
    "peak": "peak, mm",
    "average_peak": "average peak, mm",
    PREDICTED: "predicted RMSE, mm",
    RECOGNIZED: "poses recognized",
    "k_res": "slope k_res",
    "interval": "share of 95 % intervals that contain the truth",
    "hysteresis": "hysteresis, relative to the largest signal",
    "repeatability": "difference of two passes, relative to the largest signal",
}
#: Results of a layout: its design and the tests of its units.
Results = Mapping[str, Any]
#: Largest share of the total error in a split by cause that is shown.
MAX_CAUSE_SHARE = 3.0
SHARE_QUANTITIES = {RECOGNIZED, "interval", "hysteresis", "repeatability"}


def compare_number(number: PaperNumber, results: Mapping[str, Results]) -> dict[str, Any]:
    """Compare a number of the paper with the results of an experiment.

    Args:
        number: The number.
        results: Results by layout or kind of cord.

    Returns:
        The number in plain values, with `ours`: the mean over units, for ratios the ratio of the
        means, or None; `values` of the units and their `sd`; the `ratio` of ours to the paper's;
        and whether the expectation is `met`, or None without one.
    """
    n, values = number, _values(number, results.get(number.subject))
    mean = _mean(values) if values else None
    if n.over is not None:
        other = _values(n, results.get(n.over))
        other_mean = _mean(other) if other else None
        is_paired = len(values) == len(other) and all(other)
        mean = mean / other_mean if mean is not None and other_mean else None
        values = [a / b for a, b in zip(values, other, strict=True)] if is_paired else []
    met = None
    if mean is not None and n.at_most is not None:
        met = mean <= n.at_most
    if mean is not None and n.at_least is not None:
        met = mean >= n.at_least
    keys = ("over", "quantity", "decoder", "paper", "where", "at_most", "at_least", "why")
    return {
        "of": n.subject,
        **{name: getattr(n, name) for name in keys},
        "ours": mean,
        "sd": float(np.std(values, ddof=1)) if len(values) > 1 else 0.0,
        "values": values,
        "ratio": mean / n.paper if mean is not None and n.paper else None,
        "met": met,
    }


def _values(number: PaperNumber, results: Results | None) -> list[float]:
    """Return the values of all units, or that of the design."""
    if results is None:
        return []
    if number.quantity in results:  # of a cord
        return [float(v) for v in results[number.quantity]]
    design = results.get("design")
    if number.quantity == PREDICTED and design is not None:
        by_decoder = design["predicted_by_decoder"]
        return [by_decoder["affine"] if number.decoder == "affine" else design["predicted"]]
    units: Sequence[Results] = results.get("units", ())
    if number.quantity == RECOGNIZED:
        return [u["told_apart"]["share"] for u in units if u["told_apart"] is not None]
    return [u[number.decoder][number.quantity] for u in units]


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
        "layouts": [],
        "pictures": e.get("pictures"),
        "assumptions": e.get("assumptions", ()),
        "cords": e.get("cords"),
        "truth": e.get("truth"),
        "causes": None,
    }
    if "layouts" in e:
        titles = {c["name"]: c["title"] for c in e["choices"]}
        page["layouts"] = [
            _layout(name, titles[name], results) for name, results in e["layouts"].items()
        ]
        page["causes"] = _causes(e["layouts"])
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
        "what": label,
        "ours": ours,
        "expected": expected,
        "where": row["where"],
        "why": row["why"],
        "paper": "" if row["paper"] is None else _text(row["paper"], is_share),
        "ratio": "" if row["ratio"] is None else f"{row['ratio']:.2f}",
        "met": {None: "", True: "met", False: "not met"}[row["met"]],
        "spread": spread,
    }


def _text(value: float, is_share: bool = False) -> str:
    return f"{100 * value:.3g} %" if is_share else f"{value:.2f}"


def _layout(name: str, title: str, results: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of the page for a layout."""
    design, units = results["design"], results["units"]
    predicted = [u["predicted"]["promised_ratio"] for u in units if u["predicted"] is not None]
    movement = {k: [u["movement"][k] for u in units] for k in (AFFINE, "chosen")}
    return {
        "name": name,
        "title": title,
        "cords": design["cords"],
        "design": design,
        AFFINE: _errors([u[AFFINE] for u in units]),
        "chosen": _errors([u["chosen"] for u in units]),
        "truth": _errors([u["truth"] for u in units]),
        "decoders": ", ".join(dict.fromkeys(u["decoder"] for u in units)),
        "tested": units[0]["frames"]["tested"],
        "markers": units[0]["markers"],
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
    }


def _errors(rows: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    """Return means over units, and the range of their RMSE."""
    errors: dict[str, Any] = {k: _mean([r[k] for r in rows]) for k in rows[0]}
    errors["range"] = _range([r["rmse"] for r in rows])
    return errors


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))


def _range(values: Sequence[float]) -> str:
    if not values:
        return ""
    low, high = min(values), max(values)
    return f"{low:.2f}" if len(values) == 1 else f"{low:.2f} to {high:.2f}"


def _causes(layouts: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the causes' shares of the mean square error by layout, means over units.

    They are computed by removing each cause from the twin's recording. Layouts whose signals have
    so little information that noise is amplified beyond the measured errors are omitted.
    """
    budgets = {
        name: [u["causes_by_truth"] for u in results["units"] if u["causes_by_truth"]]
        for name, results in layouts.items()
    }
    omitted = [
        name for name, some in budgets.items() if not some or any(map(_is_implausible, some))
    ]
    shown = {name: some for name, some in budgets.items() if name not in omitted}
    if not shown:
        return None
    causes = dict.fromkeys(c for some in shown.values() for budget in some for c in budget)
    rows = [
        (cause, [f"{_mean([_share(b, cause) for b in some]):.0f} %" for some in shown.values()])
        for cause in causes
        if cause != "total"
    ]
    return {"layouts": list(shown), "rows": rows, "omitted": omitted}


def _share(budget: Mapping[str, float], cause: str) -> float:
    return 100 * budget.get(cause, 0.0) / budget["total"]


def _is_implausible(budget: Mapping[str, float]) -> bool:
    limit = MAX_CAUSE_SHARE * budget["total"]
    return limit <= 0 or any(abs(value) > limit for value in budget.values())
