"""Sentences of findings: what was found on a channel, and what to do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...sensing.voltage_divider import E24
from .records import Code, ExpectedCord, Finding

_TEXTS: dict[str, tuple[str, str]] = {
    "ok": ("{cord} reads {ohm}", ""),
    "not-read": (
        "{cord} is not read: its converter did not answer",
        "Check the wires between the converter and the board (SDA, SCL, supply, address)",
    ),
    "open": (
        "{cord} is open: no current flows through it",
        "Check both of its joints, its wire to ground, and that its plug is in its pin; a reference"
        " resistor that is far too small looks the same",
    ),
    "short": (
        "{cord} is shorted: its pin is at ground, or its reference resistor is missing",
        "Check that its wires do not touch, and that the reference resistor is in place",
    ),
    "bridge": (
        "{cord} touches {others}: their pins have the same voltage",
        "Separate the two pins, wires or solder joints",
    ),
    "saturated": (
        "{cord} reads {ohm} instead of {expected}, at the end of the converter's range",
        "Check the reference resistor (it would have to be {resistor}), and that the dividers are"
        " on the supply pin that the firmware assumes",
    ),
    "supply": (
        "{cord} reads {ohm} instead of {expected}: the voltages of all channels are {supply:.2f}"
        " times the expected ones",
        "Connect the dividers to the supply pin that the firmware assumes, and check the stated"
        " reference resistors",
    ),
    "swapped": (
        "{cord} and {others} are exchanged: this pin reads {others}",
        "Exchange their wires at the board",
    ),
    "reference-wrong": (
        "{cord} reads {ohm} instead of {expected}, a factor of ten",
        "Replace its reference resistor, which looks like {resistor}, or state it in the reference",
    ),
    "loose": (
        "{cord} jumps when its wire moves ({jumps:.0f} jumps)",
        "Press its plug in, or solder or crimp its joint again",
    ),
    "hum": (
        "{cord} has a hum of {hertz:.0f} Hz ({rms:.1%} of its resistance)",
        "Twist its wires, keep them away from mains and chargers, and connect the ground",
    ),
    "noisy": (
        "{cord} is noisy: {noise:.2%} instead of {limit:.2%}",
        "Shorten its wires, check its joints, and try another supply",
    ),
    "rest-off": (
        "{cord} reads {ohm}, outside of {low:.0f} to {high:.0f} ohm",
        "Measure it with a multimeter: check its length, its joints and its reference resistor",
    ),
}


def finding(
    channel: int,
    cord: ExpectedCord,
    code: Code,
    reference: float,
    data: Mapping[str, float],
    others: tuple[str, ...] = (),
) -> Finding:
    """Return the finding of a channel, with its sentences.

    Args:
        channel: Index of the channel.
        cord: The cord that belongs to it.
        code: The code; `short` with others is a connection to them.
        reference: The channel's reference resistor as assumed, ohm.
        data: Numbers for the texts.
        others: Names of the other cords concerned.
    """
    key: str = "bridge" if code == "short" and others else "supply" if "supply" in data else code
    text, action = _TEXTS[key]
    data = {k: float(v) for k, v in data.items()}
    resistor = reference * cord.ohm / data["ohm"]
    if key in ("reference-wrong", "saturated"):
        data["resistor"] = nearest_e24(resistor)
    values = {
        **data,
        "cord": f"{cord.name} (channel {channel + 1})",
        "others": " and ".join(others),
        "ohm": format_ohm(data["ohm"]),
        "expected": format_ohm(cord.ohm),
        "resistor": format_ohm(nearest_e24(resistor)),
    }
    return Finding(
        channel,
        cord.name,
        code,
        text.format(**values),
        action.format(**values),
        others,
        data,
    )


def nearest_e24(ohm: float) -> float:
    """Return the preferred value (E24) that is nearest to a resistance, ohm."""
    decade = 10.0 ** np.floor(np.log10(ohm))
    values = np.array([*E24, 10.0]) * decade
    return float(values[np.abs(np.log(values / ohm)).argmin()])


def format_ohm(ohm: float) -> str:
    """Return a resistance with its unit, as in "1146 ohm" or "22 kohm"."""
    if ohm >= 1e6:
        return f"{ohm / 1e6:.3g} Mohm"
    return f"{ohm / 1e3:.3g} kohm" if ohm >= 1e4 else f"{ohm:.4g} ohm"
