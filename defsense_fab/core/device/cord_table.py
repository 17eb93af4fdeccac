"""The table [cord] of a device file: a cord of the catalogue, or one by its data sheet."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ..errors import CalibrationError
from ..response import MeasuredResponse, ResponseSpec, read_measured, read_response
from ..storage.toml_table import Table
from .catalogue import read_rows
from .device import COMPRESSION, CordSpec

#: What a data sheet has to say of a cord that is no row of the catalogue.
SHEET = ("diameter", "ohm_per_mm", "gauge_factor", "max_strain")
_ROW = ("name", "source", "compression")


def read_cord(t: Table, lead: float, folder: Path) -> CordSpec:
    """The cord, with free ends of `lead` mm. Raises DeviceError for what is unknown, missing or out
    of range."""
    rows = read_rows("cords.csv")
    own = any([t.has(k) for k in SHEET])
    name = t.string("name", "custom" if own else None)
    if not own:
        t.choice("name", name, list(rows), "cord")
    figures = _figures(t, rows.get(name, {}))
    if figures["ferrule_diameter"] <= figures["diameter"]:
        t.fail("ferrule_diameter", f"must be more than the cord's {figures['diameter']:g} mm")
    compression = t.string("compression", rows.get(name, {}).get("compression", "same"))
    t.choice("compression", compression, list(COMPRESSION), "behaviour under compression")
    response = _from_data_sheet(figures.pop("gauge_factor"), compression)
    measured = None
    if t.has("response"):
        if t.has("compression"):
            t.fail("compression", "the response tells it; remove this key or 'response'")
        compression = "measured"
        response, measured = _measured(t, folder)
    lengths = _lengths(t, lead)
    t.done()
    return CordSpec(
        name=name,
        response=response,
        lengths=lengths,
        compression=compression,
        measured=measured,
        **figures,
    )


def _figures(t: Table, row: Mapping[str, str]) -> dict[str, float]:
    """Numbers of the row, and those of this table in their place. Of a cord without a row only the
    data sheet's are needed: the others follow the rules by which the catalogue's were assumed."""
    numbers = {k: float(v) for k, v in row.items() if k not in _ROW}
    found = {key: t.number(key, numbers.get(key), low=0) for key in SHEET}
    diameter = found["diameter"]
    assumed = {
        "min_bend_radius": 2.5 * diameter,
        "ferrule_diameter": diameter + 0.6,
        "ferrule_length": 7.0,
        "modulus": 3.0,
        "noise": 0.002,
    }
    for key, value in assumed.items():
        found[key] = t.number(key, numbers.get(key, value), low=0)
    for key, value in (("contact", 1.0), ("min_stretch", 10 * diameter)):
        found[key] = t.size(key, numbers.get(key, value))
    return found


def _measured(t: Table, folder: Path) -> tuple[ResponseSpec, MeasuredResponse | None]:
    path = folder / t.string("response")
    try:
        return read_response(path), read_measured(path)
    except CalibrationError as error:
        t.fail("response", str(error))


def _lengths(t: Table, lead: float) -> tuple[float, float]:
    if not t.has("length"):
        return 0.0, float("inf")
    shortest, longest = t.vector("length", 2).tolist()
    if not 0 <= shortest <= longest - 1:
        t.fail("length", "give the least and the greatest length of a piece, as in [100, 400]")
    if longest < 2 * lead + 1:
        t.fail(
            "length",
            f"a piece of {longest:g} mm is used up by its two free ends of {lead:g} mm"
            " ([fabrication] lead)",
        )
    return shortest, longest


def _from_data_sheet(gauge_factor: float, compression: str) -> ResponseSpec:
    """The response of a cord of which only its behaviour in tension is known."""
    if COMPRESSION[compression] == 1:
        return ResponseSpec.line(gauge_factor)
    slopes = {"tension": gauge_factor, "compression": gauge_factor * COMPRESSION[compression]}
    return ResponseSpec("two-slopes", slopes)
