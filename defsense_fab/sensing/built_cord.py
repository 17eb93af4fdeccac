"""A cord as it is built in: how much of it is stretched, how, and how finely that can be read.

Two ways to build it in (ASSEMBLIES of a device). *Bonded*, glued into its groove all along,
as the paper does it (DefSense, CHI 2016, section 5: secured with adhesives), it follows the body's
local strain, compression too. *Held* at its ends alone it slides in its channel and is strained
evenly, by how far its ends' way through the body becomes longer; it cannot push: below its own rest
length it is slack. Stretched by p as it is laid, it has a strain of (1 + p)(1 + e) - 1 where the
body's mean strain is e, and stays taut down to e = 1/(1 + p) - 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Float
from ..core.curve import arc_lengths
from ..core.device.device import CONVERTERS, Device
from .response import Response, mean_strain, response_of, signals

#: Standard deviation of what a held cord is stretched by as it is laid by hand, a strain.
PRESTRETCH_SPREAD = 0.01
#: It is stretched for poses that are taken so much further than they were solved, and by so many
#: standard deviations more: a cord that is laid with less is slack in some state, and senses
#: nothing there.
_FURTHER, _SURE = 1.1, 2


@dataclass(frozen=True)
class BuiltCord:
    """The cord's `path` (p, 3) mm between its ends, which the body stretches; cord in `series`
    before and behind, mm, that conducts and is not stretched; by how much it is stretched as it is
    laid, or None for a bonded one."""

    path: Float
    series: float
    prestretch: float | None

    @property
    def length(self) -> float:
        """Of the path, mm."""
        return float(arc_lengths(self.path)[-1])


@dataclass(frozen=True)
class CordReading:
    """How cords of one kind are read: `response` to the cord's own strain, `ohm_per_mm`, standard
    deviations: `relative` of (R - R0)/R0 however long the cord, `contact` of each joint, ohm."""

    response: Response
    ohm_per_mm: float
    relative: float
    contact: float

    @classmethod
    def of(cls, device: Device) -> CordReading:
        """Of the device's cord and converter."""
        cord = device.cord
        relative = float(np.hypot(cord.noise, steps(device.converter)))
        return cls(response_of(cord.response), cord.ohm_per_mm, relative, cord.contact)

    def resistance(self, cord: BuiltCord) -> float:
        """Between the joints at rest, ohm."""
        return self.ohm_per_mm * (self.conducting(cord.length, cord.prestretch) + cord.series)

    def conducting(self, length: float, prestretch: float | None) -> float:
        """Loose cord, mm, that has the resistance of one that is stretched over a `length`."""
        p = prestretch or 0.0
        return length / (1 + p) * (1 + float(self.response(np.array(p))))

    def signals(self, cord: BuiltCord, deformed: Float) -> Float:
        """(R - R0)/R0 (s,) with the path at `deformed` (s, p, 3) mm."""
        if cord.prestretch is None:
            found = signals(cord.path, deformed, self.response)
        else:
            answer = held(self.response, cord.prestretch)
            found = answer(mean_strain(cord.path, deformed))
        rest = self.conducting(cord.length, cord.prestretch)
        return np.asarray(found * rest / (rest + cord.series))

    def noise(self, cord: BuiltCord) -> float:
        """Standard deviation of (R - R0)/R0: what a joint adds to it, a short cord feels most."""
        return float(self.noise_of(np.array(self.resistance(cord))))

    def noise_of(self, resistance: Float) -> Float:
        """The same (...) for cords of these resistances (...) at rest, ohm."""
        return np.asarray(np.hypot(self.relative, np.sqrt(2) * self.contact / resistance))

    def gauge_spread(self, factor: float, compression: float = 1.0) -> CordReading:
        """The same for a cord whose response is `factor` times as large, and in compression
        `compression` times that."""
        return replace(self, response=scaled(self.response, factor, compression))


def steps(converter: str) -> float:
    """Standard deviation of (R - R0)/R0 by the steps of a converter, in a divider whose reference
    resistor equals the cord (4/N a count, see `voltage_divider`), averaged over a sample."""
    full_scale, averages = CONVERTERS[converter]
    return 4 / full_scale / float(np.sqrt(12 * averages))


def held(response: Response, prestretch: float) -> Response:
    """What a held cord answers to the body's mean strain e, relative to its resistance as laid:
    (w(eps) - w(p)) / (1 + w(p)) with eps = max((1 + p)(1 + e) - 1, 0)."""
    return _laid(_taut(response), prestretch)


def held_taut(response: Response, prestretch: float) -> Response:
    """The same for a cord that is stretched so far that no state leaves it slack: below zero strain
    the response goes on along its tangent there."""
    return _laid(_from_rest(response), prestretch)


def needed_prestretch(least_strain: float) -> float:
    """How far to stretch a cord that it stays taut down to the body's mean strain `least_strain`
    along it, though it is not laid exactly so: in whole per cents."""
    needed = max(1 / (1 + _FURTHER * least_strain) - 1, 0.0)
    return round(float(np.ceil(100 * needed - 1e-6)) / 100 + _SURE * PRESTRETCH_SPREAD, 2)


def scaled(response: Response, factor: float, compression: float) -> Response:
    """`factor` times the response, and `compression` times that below zero strain."""
    if compression == 1:
        return replace(response, pieces=factor * response.pieces)
    split = _with_break(response, 0.0)
    below = np.append(split.breaks, np.inf) <= 0
    return replace(split, pieces=factor * np.where(below[:, None], compression, 1.0) * split.pieces)


def _with_break(response: Response, at: float) -> Response:
    """The same with a break there."""
    if at in response.breaks:
        return response
    i = int(np.searchsorted(response.breaks, at))
    return Response(
        np.insert(response.breaks, i, at),
        np.insert(response.origins, i, response.origins[i]),
        np.insert(response.pieces, i, response.pieces[i], axis=0),
    )


def _taut(response: Response) -> Response:
    """Zero below zero strain."""
    split = _with_break(response, 0.0)
    below = np.append(split.breaks, np.inf) <= 0
    return replace(split, pieces=np.where(below[:, None], 0.0, split.pieces))


def _from_rest(response: Response) -> Response:
    """Above zero strain as it is; below, along the tangent there."""
    if response.slope_everywhere is not None:
        return response
    split = _with_break(response, 0.0)
    i = int(np.searchsorted(split.breaks, 0.0)) + 1
    shift = -split.origins[i]
    _, b, c, d = split.pieces[i]
    slope = b + shift * (2 * c + 3 * d * shift)
    return Response(
        split.breaks[i - 1 :],
        np.append(0.0, split.origins[i:]),
        np.concatenate([[[0.0, slope, 0.0, 0.0]], split.pieces[i:]]),
    )


def _laid(response: Response, p: float) -> Response:
    """As a function of e, the cord's strain being (1 + p)(1 + e) - 1 = (1 + p)(e - e0) with
    e0 = 1/(1 + p) - 1, and relative to the resistance at e = 0."""
    before = float(response(np.array(p)))
    slope = response.slope_everywhere
    if slope is not None:
        return Response.line(slope * (1 + p) / (1 + before))
    pieces = response.pieces * (1 + p) ** np.arange(4)
    pieces[:, 0] -= before
    return Response(
        (response.breaks - p) / (1 + p), (response.origins - p) / (1 + p), pieces / (1 + before)
    )
