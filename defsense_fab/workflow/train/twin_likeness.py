"""Compare how the cords or traces of a session respond with twins of the families of memories."""

from __future__ import annotations

from dataclasses import astuple, replace

import numpy as np

from ...core.arrays import Float
from ...core.device.device import Device
from ...training.data.dataset import Dataset, Recording
from ...training.evaluation.cord_character import (
    CordCharacter,
    TwinLikeness,
    ideal_signals,
    measure_character,
    target_terms,
)
from ...twin.electronics.rubber_cords import (
    CORD_FAMILIES,
    RubberPieces,
    RubberState,
    RubberTraits,
)
from ...twin.options import DEFAULT_TRACES

UNITS = 5  # twins of each family
LIKENESS_SEED = 17


def compare_with_twins(dataset: Dataset, device: Device | None = None) -> TwinLikeness | None:
    """Measure how the cords of a session respond, and those of twins that move like it.

    The twins' cords follow the session's signals without memory, so no simulation of the device is
    needed.

    Args:
        dataset: The session's dataset.
        device: The device, whose cord has the noise of the twins; None for no twins.

    Returns:
        None if the session is too short.
    """
    terms = target_terms(dataset)
    ideal = ideal_signals(dataset, terms)
    session = None if ideal is None else measure_character(dataset, ideal)
    if ideal is None or session is None:
        return None
    twins: dict[str, tuple[CordCharacter, CordCharacter]] = {}
    if device is not None:
        # Data of signals only have R0 = 1, in which joints of some ohm have no share.
        has_ohms = any((r.rest != 1).any() for r in dataset.recordings)
        contact = device.cord.contact if has_ohms else 0.0
        for name, family in CORD_FAMILIES.items():
            if name == DEFAULT_TRACES and device.cord.trace is None:
                continue
            traits = RubberTraits(family(), noise=device.cord.noise, contact=contact)
            units = [_simulate(dataset, ideal, traits, k) for k in range(UNITS)]
            ideals = [ideal_signals(unit, terms) for unit in units]
            characters = [
                c
                for unit, own in zip(units, ideals, strict=True)
                if own is not None and (c := measure_character(unit, own)) is not None
            ]
            if characters:
                twins[name] = _range(characters)
    return TwinLikeness(session, twins)


def _simulate(dataset: Dataset, ideal: list[Float], traits: RubberTraits, unit: int) -> Dataset:
    """Return the dataset with the resistances of a twin's cords."""
    rng = np.random.default_rng([LIKENESS_SEED, unit])
    rest = dataset.recordings[0].rest
    nominal = np.where(np.isfinite(rest) & (rest > 0), rest, 1.0)
    pieces = RubberPieces.draw(traits, nominal, rng)
    recordings: list[Recording] = []
    for r, s in zip(dataset.recordings, ideal, strict=True):
        signals = np.stack([np.interp(r.sample_time, r.time, column) for column in s.T], axis=1)
        state = RubberState.new(traits, s.shape[1])
        ohm, _ = pieces.simulate(r.sample_time, signals, state, rng)
        ohm = np.where(np.isfinite(r.ohm), ohm, np.nan)
        recordings.append(replace(r, ohm=ohm, rest=pieces.ohm))
    return replace(dataset, recordings=tuple(recordings))


def _range(characters: list[CordCharacter]) -> tuple[CordCharacter, CordCharacter]:
    """Return the lowest and the highest of each number; NaN if no unit shows it."""
    columns = zip(*(astuple(c) for c in characters), strict=True)
    known = [[v for v in column if np.isfinite(v)] or [np.nan] for column in columns]
    return CordCharacter(*map(min, known)), CordCharacter(*map(max, known))
