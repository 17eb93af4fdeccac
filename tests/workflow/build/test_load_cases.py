"""Test the load cases of a device whose file gives some lists of states."""

from dataclasses import replace

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.device.states import default_states
from defsense_fab.store.fields import StateRecord
from defsense_fab.workflow.build.load_cases import describe_states, list_loadings
from tests.support.places import BAR


@pytest.fixture(scope="module")
def bar():
    return load_device(BAR)


@pytest.mark.parametrize(
    ("mixtures", "held_out"),
    [(None, None), (None, [{"twist": 0.9}]), ([{"bend_up": 0.6, "twist": 0.4}], None), ([], [])],
)
def test_only_states_of_proposed_lists_are_optional(bar, mixtures, held_out):
    states = default_states(bar.poses, bar.states.ramp, mixtures, held_out)
    loadings = list_loadings(replace(bar, states=states))
    mixed = [p for p in loadings if len(p.weights) > 1 or p.held_out]
    assert {p.optional for p in mixed if not p.held_out} <= {mixtures is None}
    assert {p.optional for p in mixed if p.held_out} <= {held_out is None}
    assert not any(p.optional for p in loadings if p not in mixed)
    assert any(p.held_out for p in loadings) == (held_out != [])
    assert any(len(p.weights) > 1 and not p.held_out for p in loadings) == (mixtures != [])


def test_states_are_counted_by_use_and_origin(bar):
    held_out = [{"bend_up": 0.6, "twist": 0.4}]
    spec = default_states(bar.poses, bar.states.ramp, held_out=held_out)
    records = [
        StateRecord(p.state(f), p.weights, p.held_out, "ok", 1, 1, 1, 0.0, 0.0)
        for p in list_loadings(replace(bar, states=spec))
        for f in p.fractions
    ]
    text = describe_states(records, spec)
    assert "12 of 3 poses" in text
    assert "4 mixtures (proposed) fitted" in text
    assert "1 mixture held out" in text
    assert "none held out" in describe_states(records[:12], spec)
