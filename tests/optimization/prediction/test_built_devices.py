"""Errors expected of built devices after training, by the kind of memory of their cords."""

from dataclasses import replace

import pytest

from defsense_fab.core.device.device_file import load_device
from defsense_fab.optimization.prediction.built_devices import predict_built_devices
from defsense_fab.optimization.prediction.design_task import load_task
from defsense_fab.store.build import Build
from defsense_fab.workflow.design.session_shares import session_shares
from tests.runtime.live.conftest import live_bar as live_bar_fixture
from tests.twin.conftest import small_bar as small_bar_fixture

small_bar, live_bar = small_bar_fixture, live_bar_fixture


@pytest.fixture(scope="module")
def predict(live_bar):
    device = load_device(live_bar.folder)
    build = Build(live_bar.folder / "build")
    task = load_task(device, build).with_decoder(build.layout.prediction.decoder)
    cords = [record.built for record in build.layout.by_channel()]

    def band(cord, session=False):
        named = replace(device, cord=replace(device.cord, name=cord))
        shares = session_shares(device, task.weights) if session else None
        return predict_built_devices(named, task, cords, shares)

    return band


@pytest.mark.slow
def test_the_median_is_of_the_memory_that_a_cord_has(predict):
    unknown, knitted = predict("custom"), predict("graphene-knit")
    assert (unknown.family, knitted.family) == ("", "hysteretic")
    assert knitted.families == unknown.families
    assert knitted.trained.median == knitted.families["hysteretic"].median
    low, high = sorted(f.median for f in unknown.families.values())
    assert low < unknown.trained.median < high
    assert "on hysteretic cords" in knitted.describe_trained()


@pytest.mark.slow
def test_memory_adds_to_the_error_of_the_same_session(predict):
    band = predict("custom", session=True)
    assert band.without_memory is not None
    assert band.noise_part == band.without_memory
    assert all(band.without_memory <= f.median for f in band.families.values())


@pytest.mark.slow
def test_the_range_is_of_all_kinds_of_memory(predict):
    unknown, knitted = predict("custom").trained, predict("graphene-knit").trained
    assert (knitted.low, knitted.high) == (unknown.low, unknown.high)
