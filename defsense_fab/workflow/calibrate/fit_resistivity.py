"""Fit a filament's resistivities to the measured coupon of printed traces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...calibration.readings_table import read_resistance
from ...calibration.trace_resistivity import CouponTrace, Estimate, ResistivityFit
from ...calibration.trace_resistivity import fit_resistivity as fit
from ...core.arrays import Float, Int
from ...core.device.filaments import read_filaments
from ...core.errors import CalibrationError
from ...core.storage.delimited_text import read_delimited
from ...core.storage.files import load_json
from .calibration_parts import COUPON_FILE
from .options import ResistivityOptions

_WRITE_COUPON = "Write it with 'defsense calibrate trace-coupon'"
_DEFAULTS = ResistivityOptions()
#: Deviation of a trace that is not fitted, in standard deviations of a reading, that is reported.
MAX_CHECK_SPREADS = 3.0


@dataclass(frozen=True)
class TraceCoupon:
    """A coupon of printed traces.

    Attributes:
        filament: Conductive filament.
        width: Width of its usual traces, mm.
        height: Height of its traces, mm.
        resistivity: Resistivity along beads that the coupon was written with, ohm mm.
        between_layers: Resistivity between layers as a multiple of it, then.
        traces: The traces, in the order of the numbers engraved on the coupon.
    """

    filament: str
    width: float
    height: float
    resistivity: float
    between_layers: float
    traces: tuple[CouponTrace, ...]


@dataclass(frozen=True)
class MeasuredCoupon:
    """Resistivities of a filament by a coupon.

    Attributes:
        coupon: The coupon.
        trace: Index (n,) of the trace of each reading.
        resistance: The readings (n,), ohm.
        fit: The fit to them.
        notes: What the user should know about the fit.
    """

    coupon: TraceCoupon
    trace: Int
    resistance: Float
    fit: ResistivityFit
    notes: tuple[str, ...]

    @property
    def cord_lines(self) -> tuple[str, ...]:
        """Lines of `[cord]` in `device.toml` that state the fitted numbers."""
        c, f = self.coupon, self.fit
        lines = [
            "[cord]",
            'process = "printed"',
            f'trace = "{c.filament}"',
            f"width = {c.width:g}",
            f"height = {c.height:g}",
            f"resistivity = {f.resistivity.value:.4g}",
            f"between_layers = {f.between_layers.value:.3g}",
            f"contact = {max(f.contact.value, f.contact.error):.3g}",
        ]
        if c.filament not in read_filaments():
            lines.append("# and gauge_factor, max_strain and modulus, as there is no row")
        return tuple(lines)


def read_coupon(path: Path) -> TraceCoupon:
    """Read the `coupon.json` of printed traces.

    Args:
        path: The file, or its folder.

    Raises:
        CalibrationError: The file cannot be read, or is that of another coupon.
    """
    file = path / COUPON_FILE if path.is_dir() else path
    data = load_json(file, CalibrationError, _WRITE_COUPON)
    try:
        traces = tuple(
            CouponTrace(
                str(t["name"]),
                float(t["along"]),
                float(t["between"]),
                float(t["resistance"]),
                bool(t["fitted"]),
            )
            for t in data["traces"]
        )
        return TraceCoupon(
            str(data["filament"]),
            float(data["trace_width"]),
            float(data["trace_height"]),
            float(data["resistivity"]),
            float(data["between_layers"]),
            traces,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise CalibrationError(
            f"does not describe a coupon of printed traces ({error!r})",
            code="coupon-file-invalid",
            where=file,
            action=_WRITE_COUPON,
        ) from None


def fit_resistivity(path: Path, options: ResistivityOptions = _DEFAULTS) -> MeasuredCoupon:
    """Fit resistivity, `between_layers` and the pads' resistance to a measured coupon.

    Args:
        path: `coupon.json` of printed traces, or its folder.
        options: The readings.

    Returns:
        The fit, its readings, and notes about them.

    Raises:
        CalibrationError: The coupon or a reading is invalid, or the readings do not determine the
            three numbers.
    """
    coupon, o = read_coupon(path), options
    if (o.ohm is None) == (o.readings is None):
        raise CalibrationError(
            "no resistances are given" if o.ohm is None else "resistances are given twice",
            code="argument-missing" if o.ohm is None else "options-exclusive",
            where="ohm",
            action="Give the resistances, or a table of readings",
        )
    if o.ohm is not None:
        if len(o.ohm) != len(coupon.traces):
            raise CalibrationError(
                f"{len(o.ohm)} resistances are given, and the coupon has"
                f" {len(coupon.traces)} traces",
                code="resistance-count-differs",
                where="ohm",
                action="Give one for each trace, in the order of the engraved numbers, or a table",
                count=len(coupon.traces),
            )
        trace, resistance = np.arange(len(o.ohm)), np.array(o.ohm, float)
    else:
        assert o.readings is not None
        trace, resistance = read_resistances(o.readings, [t.name for t in coupon.traces])
    result = fit(coupon.traces, trace, resistance, o.spread / 100)
    return MeasuredCoupon(
        coupon, trace, resistance, result, _notes(coupon, trace, result, o.spread / 100)
    )


def read_resistances(path: Path, names: Sequence[str]) -> tuple[Int, Float]:
    """Read a table with the columns `trace` (a name or number) and `resistance` (ohm).

    Args:
        path: Table in text; see `core.storage.delimited_text` for its forms.
        names: Names of the coupon's traces.

    Returns:
        The index of the trace (n,) and the resistance (n,) of each row.

    Raises:
        CalibrationError: A column is missing, or a cell invalid.
    """
    table = read_delimited(path, CalibrationError, path.name)
    table.rename([name.lower() for name in table.names])
    absent = [name for name in ("trace", "resistance") if name not in table.names]
    if absent:
        raise CalibrationError(
            f"the columns {', '.join(absent)} are missing",
            code="column-missing",
            where=table.place(table.header_line),
            action="Name the columns trace and resistance",
            columns=absent,
        )
    index = {name: n for n, name in enumerate(names)}
    index |= {str(n): n - 1 for n in range(1, len(names) + 1)}
    traces, ohms = [], []
    for line, cells in table.rows():
        row = dict(zip(table.names, cells, strict=False))
        name = row.get("trace", "").strip().lower()
        if name not in index:
            raise CalibrationError(
                f"unknown trace {name!r}",
                code="unknown-trace",
                where=f"{table.place(line)}: trace",
                action=f"Give a number, or one of {', '.join(names)}",
                value=name,
            )
        traces.append(index[name])
        ohms.append(read_resistance(table, line, row.get("resistance", "")))
    if not traces:
        raise CalibrationError(
            "the table has no rows below its header",
            code="no-rows",
            where=path,
            action="Add one row per reading",
        )
    return np.array(traces, int), np.array(ohms, float)


def _notes(coupon: TraceCoupon, trace: Int, fit: ResistivityFit, spread: float) -> tuple[str, ...]:
    """Return notes on readings that disagree, and on numbers that they do not determine."""
    notes = []
    for n, t in enumerate(coupon.traces):
        mean = float(fit.deviation[trace == n].mean()) if (trace == n).any() else 0.0
        if not t.is_fitted and abs(mean) > MAX_CHECK_SPREADS * fit.spread:
            notes.append(
                f"trace {t.name} ({n + 1}), which is not fitted, differs by {mean:+.0%} from the"
                " fit: expect such differences of traces that rise as it does"
            )
    if fit.suspect is not None:
        name = coupon.traces[fit.suspect].name
        notes.append(
            f"the readings are inconsistent: they are {fit.spread:.1%} from the fit, and"
            f" {spread:.1%} is expected. Without trace {name} ({fit.suspect + 1}) they agree best:"
            " check its connections and its G-code, and measure again"
        )
    if fit.between_layers.value < 1:
        notes.append(
            f"between_layers is {fit.between_layers.value:.2f}, but layers do not conduct better"
            " than beads: check the rising traces"
        )
    if fit.contact.value <= fit.contact.error:
        notes.append(
            f"the resistance of a pad ({fit.contact.value:.0f} ohm) is not significantly different"
            f" from zero; contact is its standard error, {fit.contact.error:.0f} ohm"
        )
    return tuple(notes)


def plain_fit(measured: MeasuredCoupon) -> dict[str, object]:
    """Return a fit for JSON."""
    fit, coupon = measured.fit, measured.coupon

    def plain(estimate: Estimate) -> dict[str, float]:
        return {"value": estimate.value, "error": estimate.error}

    return {
        "filament": coupon.filament,
        "resistivity": plain(fit.resistivity),
        "between_layers": plain(fit.between_layers),
        "contact": plain(fit.contact),
        "spread": fit.spread,
        "probability": fit.probability,
        "suspect": None if fit.suspect is None else coupon.traces[fit.suspect].name,
        "readings": [
            {
                "trace": coupon.traces[int(n)].name,
                "resistance": float(ohm),
                "fitted": float(fitted),
                "is_fitted": coupon.traces[int(n)].is_fitted,
                "predicted": coupon.traces[int(n)].resistance,
            }
            for n, ohm, fitted in zip(measured.trace, measured.resistance, fit.fitted, strict=True)
        ],
        "cord": list(measured.cord_lines),
        "notes": list(measured.notes),
    }
