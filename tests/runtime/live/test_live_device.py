"""What a run knows of its device, and what it refuses."""

import json
import shutil

import numpy as np
import pytest
from defsense_fab.runtime.live.live_device import live_device
from defsense_fab.training.models.model_file import load_model, write_model

from defsense_fab.core.errors import LiveError, TrainingError


def test_the_model_s_folder_is_the_device_s_and_its_build_tells_poses_surface_and_cords(live_bar):
    found = live_device(live_bar.model)
    assert found.wired == ("cord_1", "cord_2")
    assert found.reference.tolist() == [1500.0, 1000.0]
    assert found.trained_rest.tolist() == [1500.0, 900.0]
    assert found.poses.names == ("bend_up", "twist")
    assert found.states.shape == (4, len(found.rest.vertices), 3)
    assert [c.name for c in found.cords] == ["cord_1", "cord_2"]


def test_a_model_alone_has_no_surface(live_bar, tmp_path):
    shutil.copy(live_bar.model, tmp_path / "model.json")
    found = live_device(tmp_path / "model.json")
    assert (found.device, found.rest, found.poses) == (None, None, None)
    assert found.wired == found.model.channels


def changed(live_bar, tmp_path, **changes):
    from dataclasses import replace

    path = tmp_path / "model.json"
    write_model(path, replace(load_model(live_bar.model), **changes))
    return path


def test_models_of_other_devices_cords_and_channels_are_refused(live_bar, tmp_path):
    folder = live_bar.folder
    with pytest.raises(LiveError, match=r"is a model of cube, and .* is bar; give --device"):
        live_device(changed(live_bar, tmp_path, device="cube"), folder)
    with pytest.raises(LiveError, match="was trained with other cords"):
        live_device(changed(live_bar, tmp_path, layout="0" * 16), folder)
    with pytest.raises(LiveError, match=r"knows the channels a, b, and .* has cord_1, cord_2"):
        live_device(changed(live_bar, tmp_path, channels=("a", "b")), folder)


def test_a_model_that_was_edited_is_refused(live_bar, tmp_path):
    data = json.loads(live_bar.model.read_text("utf-8"))
    data["gain"][0] = 2.0
    (tmp_path / "model.json").write_text(json.dumps(data))
    with pytest.raises(TrainingError, match="was changed after it was written"):
        live_device(tmp_path / "model.json", live_bar.folder)


def test_the_order_of_a_model_s_channels_is_its_own(live_bar, tmp_path):
    model = load_model(live_bar.model)
    path = changed(live_bar, tmp_path, channels=model.channels[::-1])
    assert live_device(path, live_bar.folder).wired == ("cord_1", "cord_2")
    assert np.array_equal(live_device(path, live_bar.folder).reference, [1000.0, 1500.0])
