"""Cords as they are built into a device: what stretches them, and how precisely they are read.

A cord is built in one of two ways (ASSEMBLIES of a device). A bonded cord is glued into its groove
along its whole length, as in the paper (DefSense, CHI 2016, section 5: secured with adhesives). It
follows the body's local strain, compression included. A held cord is fixed at its ends and slides
in its channel. Its strain is uniform and follows from the length of its path through the body. It
cannot push: below its own rest length it is slack. Stretched by p during assembly, its strain is
(1 + p)(1 + e) - 1 where the body's mean strain along it is e, and it stays taut down to
e = 1/(1 + p) - 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Float
from ..core.curve import arc_lengths
from ..core.device.boards import CONVERTERS
from ..core.device.device import Device
from ..core.machine import kernels
from .response import Response, build_response, cord_signals, mean_strain

#: Standard deviation of the strain by which a held cord is stretched by hand during assembly.
PRESTRETCH_SPREAD = 0.01
#: A held cord with too little prestretch is slack in some state, and senses nothing there. So it is
#: stretched for states that go further than the simulated ones by this factor, and by this number
#: of standard deviations more.
_STATE_MARGIN, _PRESTRETCH_SIGMAS = 1.1, 2


@dataclass(frozen=True)
class BuiltCord:
    """A cord in a device.

    Attributes:
        path: Path (p, 3) between its ends, which the body stretches, mm.
        series: Length of cord before and after the path, which conducts and is not stretched, mm;
            zero for a printed trace.
        prestretch: Strain at assembly; None for a bonded cord.
    """

    path: Float
    series: float
    prestretch: float | None

    @property
    def length(self) -> float:
        """Length of the path, mm."""
        return float(arc_lengths(self.path)[-1])


@dataclass(frozen=True)
class TraceSection:
    """Cross-section of printed traces, which conduct differently by direction.

    A trace is swept by an upright cylinder, and its beads follow it. So a level trace has the area
    width x height and conducts along its beads; a vertical one has the area of a disc and conducts
    from layer to layer. Slopes below 1 in 10 count less, because they are printed in steps that are
    lower than a layer over the trace's width. The formula, for predictions and searches alike, is
    in `kernels/cords.c`.

    Attributes:
        width: Width across the path, mm.
        height: Height of a level trace, mm.
        up: Unit direction (3,) of printing.
        between_layers: Resistivity between layers, as a multiple of that along beads.
    """

    width: float
    height: float
    up: Float
    between_layers: float

    @property
    def values(self) -> Float:
        """The section (5,) as compiled loops take it: up, between layers, and disc over level."""
        disc = np.pi / 4 * self.width / self.height
        return np.array([*self.up, self.between_layers, disc])

    def relative_resistance(self, path: Float) -> Float:
        """Return the resistance per length of the segments of a path (p, 3) mm.

        Returns:
            Multiples (p - 1,) of that of a level trace.
        """
        out = np.empty((len(path), 4))
        kernels.fill_conduction(np.ascontiguousarray(path, float), self.values, out)
        return out[1:, 0]

    def resistance_shares(self, path: Float) -> tuple[Float, Float]:
        """Return the parts of the resistance along beads and between layers.

        Args:
            path: Points (p, 3), mm.

        Returns:
            For each segment (p - 1,) the resistance per length along beads, and that between
            layers if these conducted as well as beads, as multiples of that of a level trace.
        """
        along, both = (
            replace(self, between_layers=k).relative_resistance(path) for k in (0.0, 1.0)
        )
        return along, both - along


@dataclass(frozen=True)
class CordReading:
    """How cords of one kind are read.

    Attributes:
        response: Response to the cord's own strain.
        ohm_per_mm: Resistance per length of loose cord, ohm/mm.
        relative: Standard deviation of (R - R0)/R0, whatever the cord's length.
        contact: Standard deviation of the resistance of each joint, ohm.
        section: Cross-section of printed traces; None for cords.
    """

    response: Response
    ohm_per_mm: float
    relative: float
    contact: float
    section: TraceSection | None = None

    @classmethod
    def from_device(cls, device: Device) -> CordReading:
        """Create the readings of a device's cord by its converter."""
        cord = device.cord
        relative = float(np.hypot(cord.noise, quantization_noise(device.converter)))
        section = None
        if cord.trace is not None:
            t, up = cord.trace, np.array(device.fabrication.up)
            section = TraceSection(t.width, t.height, up, t.between_layers)
        response = build_response(cord.response)
        return cls(response, cord.ohm_per_mm, relative, cord.contact, section)

    def resistance(self, cord: BuiltCord) -> float:
        """Return the resistance between the joints at rest, ohm."""
        if self.section is not None:
            ratio = self.section.relative_resistance(cord.path)
            return self.ohm_per_mm * float(ratio @ np.diff(arc_lengths(cord.path)))
        return self.ohm_per_mm * (
            self.conducting_length(cord.length, cord.prestretch) + cord.series
        )

    def conducting_length(self, length: float, prestretch: float | None) -> float:
        """Return the length of loose cord with the resistance of a stretched one.

        Args:
            length: Length of the stretched cord, mm.
            prestretch: Its strain; None for a bonded cord.

        Returns:
            The length of loose cord, mm.
        """
        p = prestretch or 0.0
        return length / (1 + p) * (1 + float(self.response(np.array(p))))

    def signals(self, cord: BuiltCord, deformed: Float) -> Float:
        """Return the signals of a cord in deformed states.

        Args:
            cord: The cord.
            deformed: Its path in each state (s, p, 3), mm.

        Returns:
            (R - R0)/R0 in each state (s,).
        """
        if cord.prestretch is None:
            section = self.section
            ratio = None if section is None else section.relative_resistance(cord.path)
            signals = cord_signals(cord.path, deformed, self.response, ratio)
        else:
            response = held_response(self.response, cord.prestretch)
            signals = response(mean_strain(cord.path, deformed))
        rest = self.conducting_length(cord.length, cord.prestretch)
        return np.asarray(signals * rest / (rest + cord.series))

    def noise(self, cord: BuiltCord) -> float:
        """Return the standard deviation of (R - R0)/R0; joints affect short cords most."""
        return float(self.noise_at(np.array(self.resistance(cord))))

    def noise_at(self, resistance: Float) -> Float:
        """Return the standard deviations (...) for cords of rest resistances (...) in ohm."""
        return np.asarray(np.hypot(self.relative, np.sqrt(2) * self.contact / resistance))

    def scale_resistance(self, factor: float) -> CordReading:
        """Return the readings of a cord with `factor` times the resistance at rest."""
        return replace(self, ohm_per_mm=factor * self.ohm_per_mm)

    def scale_gauge_factor(self, factor: float, compression: float = 1.0) -> CordReading:
        """Return the readings of a cord with another gauge factor.

        Args:
            factor: Factor of the response.
            compression: Additional factor of the response below zero strain.
        """
        return replace(self, response=scale_response(self.response, factor, compression))


def quantization_noise(converter: str) -> float:
    """Return the standard deviation of (R - R0)/R0 that comes from a converter's steps.

    The divider's reference resistor is assumed to equal the cord (4/N per count, see
    `voltage_divider`), and a sample is an average.

    Args:
        converter: A name in CONVERTERS.
    """
    full_scale, averages = CONVERTERS[converter]
    return 4 / full_scale / float(np.sqrt(12 * averages))


def held_response(response: Response, prestretch: float) -> Response:
    """Return the response of a held cord to the body's mean strain e along it.

    It is relative to the resistance after assembly: (w(eps) - w(p)) / (1 + w(p)) with
    eps = max((1 + p)(1 + e) - 1, 0).

    Args:
        response: Response w to the cord's own strain.
        prestretch: Strain p at assembly.
    """
    return _shift_to_body_strain(_zero_below_rest(response), prestretch)


def taut_response(response: Response, prestretch: float) -> Response:
    """Return the response of a held cord that no state leaves slack.

    As `held_response`, but below zero strain the response continues along its tangent there.
    """
    return _shift_to_body_strain(_extend_below_rest(response), prestretch)


def required_prestretch(min_strain: float) -> float:
    """Return the prestretch that keeps a held cord taut, although assembly is not exact.

    Args:
        min_strain: Smallest mean strain of the body along the cord, over all states.

    Returns:
        A strain in whole percent.
    """
    exact = max(1 / (1 + _STATE_MARGIN * min_strain) - 1, 0.0)
    percent = float(np.ceil(100 * exact - 1e-6))
    return round(percent / 100 + _PRESTRETCH_SIGMAS * PRESTRETCH_SPREAD, 2)


def scale_response(response: Response, factor: float, compression: float) -> Response:
    """Return a response times `factor`, and times `compression` below zero strain."""
    if compression == 1:
        return replace(response, pieces=factor * response.pieces)
    split = _break_at_rest(response)
    below = np.append(split.breaks, np.inf) <= 0
    return replace(split, pieces=factor * np.where(below[:, None], compression, 1.0) * split.pieces)


def _break_at_rest(response: Response) -> Response:
    """Return an equal response with a break at zero strain."""
    if 0.0 in response.breaks:
        return response
    i = int(np.searchsorted(response.breaks, 0.0))
    return Response(
        np.insert(response.breaks, i, 0.0),
        np.insert(response.origins, i, response.origins[i]),
        np.insert(response.pieces, i, response.pieces[i], axis=0),
    )


def _zero_below_rest(response: Response) -> Response:
    split = _break_at_rest(response)
    below = np.append(split.breaks, np.inf) <= 0
    return replace(split, pieces=np.where(below[:, None], 0.0, split.pieces))


def _extend_below_rest(response: Response) -> Response:
    """Return a response that follows its tangent at zero strain below that."""
    if response.linear_slope is not None:
        return response
    split = _break_at_rest(response)
    i = int(np.searchsorted(split.breaks, 0.0)) + 1
    shift = -split.origins[i]
    _, b, c, d = split.pieces[i]
    slope = b + shift * (2 * c + 3 * d * shift)
    return Response(
        split.breaks[i - 1 :],
        np.append(0.0, split.origins[i:]),
        np.concatenate([[[0.0, slope, 0.0, 0.0]], split.pieces[i:]]),
    )


def _shift_to_body_strain(response: Response, p: float) -> Response:
    """Return a response as a function of the body's strain e, relative to the resistance at e = 0.

    The cord's strain is (1 + p)(1 + e) - 1 = (1 + p)(e - e0) with e0 = 1/(1 + p) - 1.
    """
    before = float(response(np.array(p)))
    slope = response.linear_slope
    if slope is not None:
        return Response.line(slope * (1 + p) / (1 + before))
    pieces = response.pieces * (1 + p) ** np.arange(4)
    pieces[:, 0] -= before
    return Response(
        (response.breaks - p) / (1 + p), (response.origins - p) / (1 + p), pieces / (1 + before)
    )
