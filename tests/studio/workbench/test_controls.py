"""Controls for the keys of `device.toml`."""

from __future__ import annotations

import pytest

from defsense_fab.core.device.device import DECODERS
from defsense_fab.studio.workbench.controls import add_field, device_field, field_hint


class Gui:
    """Return the arguments with which a control is added."""

    def add_number(self, label, value, **options):
        return {"kind": "number", "label": label, "value": value, **options}

    def add_text(self, label, value, **options):
        return {"kind": "text", "label": label, "value": value, **options}

    def add_dropdown(self, label, choices, **options):
        return {"kind": "list", "label": label, "choices": choices, **options}


def test_a_number_has_the_declared_label_bounds_and_default():
    control = add_field(Gui(), "poses.drags.stiffness", step=0.1)
    assert (control["kind"], control["label"]) == ("number", "Stiffness, N/mm")
    low, high = device_field("poses.drags.stiffness").bounds
    assert low < control["min"] < 0.01  # the bound itself is not accepted
    assert control["max"] == high
    assert control["value"] == device_field("poses.drags.stiffness").default
    assert control["step"] == 0.1


def test_a_key_without_a_value_is_shown_as_a_number_with_a_meaning():
    control = add_field(Gui(), "design.searches", unset=(0, "as many as needed"))
    assert (control["value"], control["min"], control["step"]) == (0, 0, 1)
    assert control["hint"].endswith("0: as many as needed.")


def test_choices_and_texts_have_their_own_controls():
    decoder = add_field(Gui(), "design.decoder")
    assert (decoder["kind"], decoder["choices"]) == ("list", (*DECODERS, "auto"))
    assert decoder["initial_value"] == "auto"
    assert add_field(Gui(), "name", "bar")["kind"] == "text"


def test_hints_are_plain_text_with_the_default():
    hint = field_hint(device_field("design.decoder"))
    assert "`" not in hint
    assert hint.endswith("Default: auto.")


def test_unknown_keys_are_an_error():
    with pytest.raises(KeyError):
        device_field("mesh.edge")
