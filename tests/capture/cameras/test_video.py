"""Videos, folders of images, numbered images, and invalid files."""

import cv2
import numpy as np
import pytest

from defsense_fab.capture.cameras.image_sources import Timing, Video, measure_timing
from defsense_fab.core.errors import CaptureError
from tests.support.errors import raises

RNG = np.random.default_rng(0)
FRAMES = RNG.integers(0, 255, (20, 48, 64), dtype=np.uint8)


@pytest.fixture
def film(tmp_path):
    path = tmp_path / "film.mkv"
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"FFV1"), 25.0,
                             (64, 48), False)  # fmt: skip
    for image in FRAMES:
        writer.write(image)
    writer.release()
    return path


def test_video_frame_by_frame(film):
    video = Video(film)
    assert video.size == (64, 48)
    assert video.expected == 20
    number, time, images = zip(*video.frames(), strict=True)
    video.close()
    assert number == tuple(range(20))
    assert time == pytest.approx(np.arange(20) / 25, abs=1e-3)
    assert (np.array(images)[..., 0] == FRAMES).all()
    other = Video(film, rate=50.0)
    assert [t for _, t, _ in other.frames()] == pytest.approx(np.arange(20) / 50)
    other.close()


def test_truncated_video(film):
    data = film.read_bytes()
    film.write_bytes(data[: len(data) // 2])
    video = Video(film)
    count = len(list(video.frames()))
    video.close()
    assert 0 < count < 20


@pytest.mark.parametrize("content", [b"", b"this is a text\n" * 30, bytes(4096)])
def test_files_that_are_not_videos_are_rejected(tmp_path, content):
    path = tmp_path / "film.mkv"
    path.write_bytes(content)
    with raises(CaptureError, "video-unreadable") as error:
        Video(path)
    assert "\n" not in str(error.value)


def test_missing_files_and_empty_folders_are_rejected(tmp_path):
    with raises(CaptureError, "file-not-found"):
        Video(tmp_path / "none.mkv")
    with raises(CaptureError, "images-missing"):
        Video(tmp_path, 30.0)
    with raises(CaptureError, "video-unreadable"):
        Video(tmp_path / "a%04d.png", 30.0)


def test_images_in_a_folder_and_by_number(tmp_path):
    for k in range(11):
        cv2.imwrite(str(tmp_path / f"a{k:04d}.png"), FRAMES[k])
    for place in (tmp_path, tmp_path / "a%04d.png"):
        with raises(CaptureError, "frame-rate-missing"):
            Video(place)
        video = Video(place, 10.0)
        received = list(video.frames())
        video.close()
        assert video.size == (64, 48)
        assert [t for _, t, _ in received] == pytest.approx(np.arange(11) / 10)
        assert (np.array([i for *_, i in received])[..., 0] == FRAMES[:11]).all()


def test_images_without_leading_zeros_are_sorted_by_number(tmp_path):
    for k in range(11):
        cv2.imwrite(str(tmp_path / f"a{k}.png"), FRAMES[k])
    images = [i[..., 0] for *_, i in Video(tmp_path, 10.0).frames()]
    assert (np.array(images) == FRAMES[:11]).all()


def test_damaged_image_and_one_of_another_size(tmp_path):
    for k in range(3):
        cv2.imwrite(str(tmp_path / f"a{k}.png"), FRAMES[k])
    (tmp_path / "a1.png").write_bytes(b"not an image")
    with raises(CaptureError, "image-unreadable", file="a1.png"):
        list(Video(tmp_path, 10.0).frames())


def test_time_stamps_show_drops_repeats_and_jumps_back():
    even = np.arange(50) / 30
    assert measure_timing(even) == Timing(pytest.approx(1 / 30), 0, 0, 0)
    assert measure_timing(np.delete(even, [10, 11, 30])).missing == 3
    assert measure_timing(np.insert(even, 20, even[20])).repeated == 1
    back = even.copy()
    back[25:] -= 0.5
    assert measure_timing(back).back == 1
    shaky = even + np.random.default_rng(0).uniform(0, 0.01, 50)
    assert measure_timing(shaky).missing == 0
    assert measure_timing(np.zeros(1)) == Timing(0.0, 0, 0, 0)
    assert measure_timing(np.zeros(3)) == Timing(0.0, 0, 2, 0)
