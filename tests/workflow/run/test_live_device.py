"""A device is loaded with its model, and models that do not fit are refused."""

import json
import shutil

import numpy as np

from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import LiveError, TrainingError
from defsense_fab.training.fitting.model_file import load_model, write_model
from defsense_fab.workflow.build.results import last_build, model_of_other_cords
from defsense_fab.workflow.run.live_device import live_device
from tests.support.errors import raises


def test_build_in_the_model_folder_is_loaded(live_bar):
    live = live_device(live_bar.model)
    assert live.board_channels == ("cord_1", "cord_2")
    assert live.reference.tolist() == [1500.0, 1000.0]
    assert live.trained_rest.tolist() == [1500.0, 900.0]
    assert live.poses.names == ("bend_up", "twist")
    assert live.states.shape == (4, len(live.rest.vertices), 3)
    assert [c.name for c in live.cords] == ["cord_1", "cord_2"]


def test_model_alone_has_no_surface(live_bar, tmp_path):
    shutil.copy(live_bar.model, tmp_path / "model.json")
    live = live_device(tmp_path / "model.json")
    assert (live.device, live.rest, live.poses) == (None, None, None)
    assert live.board_channels == live.model.channels


def changed(live_bar, tmp_path, **changes):
    from dataclasses import replace

    path = tmp_path / "model.json"
    write_model(path, replace(load_model(live_bar.model), **changes))
    return path


def test_models_that_do_not_fit_are_refused(live_bar, tmp_path):
    folder = live_bar.folder
    with raises(LiveError, "device-differs", model="cube", device="bar"):
        live_device(changed(live_bar, tmp_path, device="cube"), folder)
    with raises(LiveError, "cords-differ"):
        live_device(changed(live_bar, tmp_path, layout="0" * 16), folder)
    with raises(LiveError, "channels-differ", channels=("a", "b"), present=("cord_1", "cord_2")):
        live_device(changed(live_bar, tmp_path, channels=("a", "b")), folder)


def test_a_model_of_other_cords_is_found(live_bar, tmp_path):
    folder = shutil.copytree(live_bar.folder, tmp_path / "bar")
    device = load_device(folder)
    assert model_of_other_cords(device, last_build(device)) is None
    path = changed(live_bar, folder, layout="0" * 16)
    assert model_of_other_cords(device, last_build(device)) == path


def test_edited_model_is_refused(live_bar, tmp_path):
    data = json.loads(live_bar.model.read_text("utf-8"))
    data["gain"][0] = 2.0
    (tmp_path / "model.json").write_text(json.dumps(data))
    with raises(TrainingError, "content-changed"):
        live_device(tmp_path / "model.json", live_bar.folder)


def test_model_may_have_its_own_order_of_channels(live_bar, tmp_path):
    model = load_model(live_bar.model)
    path = changed(live_bar, tmp_path, channels=model.channels[::-1])
    assert live_device(path, live_bar.folder).board_channels == ("cord_1", "cord_2")
    assert np.array_equal(live_device(path, live_bar.folder).reference, [1000.0, 1500.0])
