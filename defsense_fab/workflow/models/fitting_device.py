"""The device that a model fits, as what runs it live has it."""

from __future__ import annotations

from ...core.errors import LiveError
from ...decoding.trained_model import TrainedModel
from ...runtime.live.live_device import LiveDevice, with_build, without_build
from ...runtime.live.model_fit import Misfit, misfit
from ..given import of_kind
from ..layout import Layout

_NEEDED = "give the layout of optimise(simulate(device))"


def fitting_device(model: TrainedModel, layout: Layout | None) -> LiveDevice:
    """Of the model alone where there is no layout. Raises LiveError for a layout of another device,
    or of other cords, than those that the model was trained on."""
    if layout is None:
        return without_build(model)
    of_kind(layout, "layout", Layout, LiveError)
    device = layout.poses.device.record
    why = misfit(model, device, layout.record)
    if why is not None:
        trained = f"device {model.device!r}" if why is Misfit.DEVICE else ", ".join(model.channels)
        raise LiveError(
            f"layout: of {device.name!r}, with {', '.join(c.name for c in layout.cords)}; the model"
            f" is of {why.value} ({trained}); {_NEEDED} that it was trained on"
        )
    return with_build(model, device)
