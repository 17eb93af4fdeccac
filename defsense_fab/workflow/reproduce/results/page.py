"""The page of all experiments, in words and rounded numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ....core.version import __version__
from ....report import html
from ..experiments.experiment import AFFINE, PREDICTED, TOLD_APART

_WORDS = {
    "rmse": "RMSE, mm",
    "peak": "peak, mm",
    "average_peak": "average peak, mm",
    PREDICTED: "predicted RMSE, mm",
    TOLD_APART: "poses told apart",
    "k_res": "slope k_res",
    "interval": "share of 95 % intervals that hold the truth",
    "hysteresis": "hysteresis, of the greatest answer",
    "repeatability": "difference of two passes, of the greatest answer",
}
#: Shares of the whole beyond which a split by cause is not believed.
_BELIEVED = 3.0
_SHARES = {TOLD_APART, "interval", "hysteresis", "repeatability"}


def write_page(path: Path, data: Mapping[str, Any]) -> None:
    """One page that needs no other file, of the results of `run.reproduce`. Raises
    StorageError."""
    experiments = [_experiment(e) for e in data["experiments"]]
    html.write_page(
        path, "reproduction", experiments=experiments, quick=data["quick"], version=__version__
    )


def _experiment(e: Mapping[str, Any]) -> dict[str, Any]:
    out = {
        **{k: e[k] for k in ("name", "title", "figures", "about", "session")},
        "numbers": [number_words(row) for row in e["numbers"]],
        "layouts": [], "pictures": e.get("pictures"), "assumptions": e.get("assumptions", ()),
        "cords": e.get("cords"), "truth": e.get("truth"), "causes": None, "rebuilt": None,
        "told_apart": None,
    }  # fmt: skip
    if "layouts" in e:
        titles = {c["name"]: c["title"] for c in e["choices"]}
        out["layouts"] = [
            _layout(name, titles[name], found) for name, found in e["layouts"].items()
        ]
        out["causes"] = _causes(e["layouts"])
        out["rebuilt"] = _rebuilt(e["layouts"])
        out["told_apart"] = _told_apart(e["layouts"])
        out["twin"] = next(iter(e["layouts"].values()))["units"][0]["twin"]
    return out


def number_words(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row of an experiment's numbers, for readers."""
    share = row["quantity"] in _SHARES and row["over"] is None
    what = _WORDS[row["quantity"]]
    if row["over"] is not None:
        what = f"{row['of']} / {row['over']}: {what.removesuffix(', mm')}, times"
    else:
        what = f"{row['of']}: {what}"
    if row["decoder"] == AFFINE:
        what += ", affine decoder"
    expected = ""
    if row["at_most"] is not None:
        expected = f"at most {_text(row['at_most'], share)}"
    if row["at_least"] is not None:
        expected = f"at least {_text(row['at_least'], share)}"
    ours, spread, values = "not measured", "", row["values"]
    if row["ours"] is not None:
        ours = _text(row["ours"], share)
        if len(values) > 1:
            ours += f" ± {_text(row['sd'], share)}"
            spread = f"{_text(min(values), share)} to {_text(max(values), share)}"
    return {
        "what": what, "ours": ours, "expected": expected, "where": row["where"], "why": row["why"],
        "paper": "" if row["paper"] is None else _text(row["paper"], share),
        "ratio": "" if row["ratio"] is None else f"{row['ratio']:.2f}",
        "met": {None: "", True: "met", False: "not met"}[row["met"]],
        "spread": spread,
    }  # fmt: skip


def _text(value: float, share: bool = False) -> str:
    return f"{100 * value:.3g} %" if share else f"{value:.2f}"


def _layout(name: str, title: str, found: Mapping[str, Any]) -> dict[str, Any]:
    design, units = found["design"], found["units"]
    promised = [u["predicted"]["promised_ratio"] for u in units if u["predicted"] is not None]
    moved = {k: [u["movement"][k] for u in units] for k in (AFFINE, "chosen")}
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
            for k, rows in moved.items()
        },
        "promised": _range([p for p in promised if p]),
    }  # fmt: skip


def _errors(rows: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    """Means over units, and the range of their RMSE."""
    out: dict[str, Any] = {k: _mean([r[k] for r in rows]) for k in rows[0]}
    out["range"] = _range([r["rmse"] for r in rows])
    return out


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _range(values: Sequence[float]) -> str:
    if not values:
        return ""
    low, high = min(values), max(values)
    return f"{low:.2f}" if len(values) == 1 else f"{low:.2f} to {high:.2f}"


def _causes(layouts: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Shares of the mean square error, per cent, by cause and layout: as fitted, and by the twin's
    truth; mean over units."""
    out = []
    for key, title in (
        ("causes", "found from the recording alone"),
        ("causes_by_truth", "by taking them out of what the twin recorded"),
    ):
        by = {n: [u[key] for u in f["units"] if u[key] is not None] for n, f in layouts.items()}
        by = {n: some for n, some in by.items() if some}
        if not by:
            continue
        names = dict.fromkeys(
            c for some in by.values() for one in some for c in one if c != "total"
        )
        # A decoder of signals that tell nothing amplifies noise beyond all that is measured.
        wild = [
            n
            for n, some in by.items()
            if any(abs(v) > _BELIEVED * one["total"] for one in some for v in one.values())
        ]
        by = {n: some for n, some in by.items() if n not in wild}
        rows = [
            (cause, [_share(some, cause) for some in by.values()])
            for cause in names
        ]  # fmt: skip
        out.append({"title": title, "layouts": list(by), "rows": rows, "wild": wild})
    return out


def _share(budgets: Sequence[Mapping[str, float]], cause: str) -> str:
    shares = [100 * b.get(cause, 0.0) / b["total"] for b in budgets if b["total"]]
    return f"{np.mean(shares):.0f} %" if shares else ""


def _rebuilt(layouts: Mapping[str, Any]) -> dict[str, Any] | None:
    """Of the layout that was built without one cause after another: RMSE, mm, and what of the mean
    square goes with each; what is left without any is the decoder's and the poses'."""
    for name, found in layouts.items():
        c = found.get("causes")
        if c is not None:
            whole = c["all"] ** 2
            rows = [
                (cause, f"{rmse:.2f}", f"{100 * (whole - rmse**2) / whole:.0f} %")
                for cause, rmse in c["without"].items()
            ]
            none, left = c["without_all"], c["without_all"] ** 2 / whole
            return {"layout": name, "all": f"{c['all']:.2f}", "rows": rows, "none": f"{none:.2f}",
                    "left": f"{100 * left:.0f} %"}  # fmt: skip
    return None


def _told_apart(layouts: Mapping[str, Any]) -> dict[str, Any] | None:
    """By layout the share over all units, of so many pictures, and that of each pose."""
    out = {}
    for name, found in layouts.items():
        told = [u["told_apart"] for u in found["units"] if u["told_apart"] is not None]
        if told:
            poses = dict.fromkeys(p for t in told for p in t["by_pose"])
            out[name] = {
                "share": _text(float(np.mean([t["share"] for t in told])), True),
                "frames": sum(t["frames"] for t in told),
                "poses": {
                    p: _text(float(np.mean([t["by_pose"][p] for t in told if p in t["by_pose"]])),
                             True)
                    for p in poses
                },
            }  # fmt: skip
    return out or None
