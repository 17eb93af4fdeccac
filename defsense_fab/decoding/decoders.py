"""Decoders by name, all behind one call."""

from __future__ import annotations

from ..core.arrays import Float
from .features import KINDS
from .kernel_ridge import KernelDecoder, fit_kernel
from .ridge import Decoder, fit

Trained = Decoder | KernelDecoder


def fit_decoder(
    kind: str, signals: Float, outputs: Float, noise: Float | float, like: Trained | None = None
) -> Trained:
    """The decoder of signals (n, c) to outputs (n, o) that expects this noise (c,), or one for all
    signals; a kernel decoder takes its width and weight from `like` in place of choosing them."""
    if kind == "kernel":
        return fit_kernel(
            signals, outputs, noise, like if isinstance(like, KernelDecoder) else None
        )
    return fit(KINDS[kind](signals.shape[1]), signals, outputs, noise)
