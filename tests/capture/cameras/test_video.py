"""Videos, folders of images, numbered images, and invalid files.

`DEFSENSE_VARIANTS=1000` reads that many folders in place of the few of the suite; `-s` shows how
many were read and refused.
"""

import os
import struct

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import ExifTags
from PIL import Image as PillowImage

from defsense_fab.capture.cameras.image_sources import Timing, Video, measure_timing
from defsense_fab.core.errors import CaptureError
from tests.support.errors import raises
from tests.support.tally import Tally

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
    for pattern in ("a%04d.png", "a%s.png", "a%04d%d.png", "none/a%d.png"):
        with raises(CaptureError, "images-missing"):
            Video(tmp_path / pattern, 30.0)


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


def test_missing_numbers_of_images_keep_the_times_of_the_others(tmp_path):
    for k in (7, 8, 10, 12):
        cv2.imwrite(str(tmp_path / f"a{k:04d}.png"), FRAMES[k])
    frames = list(Video(tmp_path / "a%04d.png", 10.0).frames())
    assert [k for k, *_ in frames] == [0, 1, 2, 3]
    assert [t for _, t, _ in frames] == pytest.approx([0, 0.1, 0.3, 0.5])


def test_images_that_have_the_same_number_are_refused(tmp_path):
    for name in ("a1.png", "a01.png", "a2.png"):
        cv2.imwrite(str(tmp_path / name), FRAMES[0])
    with raises(CaptureError, "images-repeated", number=1):
        Video(tmp_path / "a%d.png", 10.0)


def test_percent_sign_in_the_name_of_a_video(film):
    other = film.with_name("100 %.mkv")
    film.rename(other)
    assert len(list(Video(other).frames())) == 20


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


def write_oriented(path, image, orientation):
    """Write an image with an orientation in its metadata."""
    picture = PillowImage.fromarray(image)
    exif = picture.getexif()
    exif[ExifTags.Base.Orientation] = orientation
    picture.save(path, exif=exif)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_images_are_turned_by_the_orientation_of_the_first(tmp_path, orientation):
    for k, stated in enumerate((orientation, 1, 3, 6, 8)):
        write_oriented(tmp_path / f"a{k}.png", FRAMES[k], stated)
    first = cv2.imread(str(tmp_path / "a0.png"), cv2.IMREAD_COLOR)
    video = Video(tmp_path, 10.0)
    images = [image for *_, image in video.frames()]
    assert video.size == first.shape[1::-1]
    assert (images[0] == first).all()
    # The same pixel of the sensor is at the same place of every image.
    for k, image in enumerate(images):
        write_oriented(tmp_path / "same.png", FRAMES[k], orientation)
        assert (image == cv2.imread(str(tmp_path / "same.png"), cv2.IMREAD_COLOR)).all()


VARIANTS = int(os.environ.get("DEFSENSE_VARIANTS", "40"))


@pytest.fixture(scope="module")
def folders():
    """Count the outcomes of folders of images."""
    tally = Tally()
    yield tally
    tally.show("folders of images")


@settings(max_examples=VARIANTS, derandomize=True, deadline=None)
@given(
    sizes=st.lists(
        st.sampled_from([(64, 48), (48, 64), (61, 46), (64, 47), (128, 96)]), min_size=1, max_size=6
    ),
    suffix=st.sampled_from([".png", ".jpg", ".bmp", ".tif", ".pgm"]),
    is_pattern=st.booleans(),
)
def test_first_image_of_another_size_is_named(tmp_path_factory, folders, sizes, suffix, is_pattern):
    folder = tmp_path_factory.mktemp("sizes")
    for k, (width, height) in enumerate(sizes):
        cv2.imwrite(str(folder / f"{k}{suffix}"), np.full((height, width), 9 * k, np.uint8))
    folders.add(lambda: read_images(folder, sizes, suffix, is_pattern))


def read_images(folder, sizes, suffix, is_pattern):
    """Check that images are read as written, or refused by the first of another size."""
    video = Video(folder / f"%d{suffix}" if is_pattern else folder, 10.0)
    other = next((k for k, size in enumerate(sizes) if size != sizes[0]), None)
    if other is None:
        images = [image for *_, image in video.frames()]
        assert [image.shape[1::-1] for image in images] == sizes
        assert [round(image.mean()) for image in images] == [9 * k for k in range(len(sizes))]
        return "read right"
    facts = {"file": f"{other}{suffix}", "size": sizes[other], "expected": sizes[0]}
    with raises(CaptureError, "image-sizes-differ", **facts):
        list(video.frames())
    return "refused"


#: Rows of the matrix in a track of an MP4 file that turn its pictures clockwise, by degrees.
MATRICES = {0: (1, 0, 0, 1), 90: (0, 1, -1, 0), 180: (-1, 0, 0, -1), 270: (0, -1, 1, 0)}


def write_turned_film(path, size, rate, count, degrees):
    """Write a film whose top left is white, with a rotation in its metadata."""
    image = np.full((size[1], size[0], 3), 60, np.uint8)
    image[: size[1] // 3, : size[0] // 3] = 255
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*"mp4v"), rate, size)
    for _ in range(count):
        writer.write(image)
    writer.release()
    data = bytearray(path.read_bytes())
    header = data.index(b"tkhd") + 4
    at = header + (56 if data[header] else 44) - 4
    a, b, c, d = (n << 16 for n in MATRICES[degrees])
    struct.pack_into(">9i", data, at, a, b, 0, c, d, 0, 0, 0, 1 << 30)
    path.write_bytes(data)


@settings(max_examples=max(VARIANTS // 4, 1), derandomize=True, deadline=None)
@given(
    width=st.integers(16, 160).map(lambda n: 2 * n),
    height=st.integers(16, 120).map(lambda n: 2 * n),
    rate=st.sampled_from([10.0, 24.0, 25.0, 30000 / 1001, 60.0, 120.0]),
    count=st.integers(1, 30),
    degrees=st.sampled_from(list(MATRICES)),
)
def test_films_of_all_sizes_rates_and_rotations(
    tmp_path_factory, width, height, rate, count, degrees
):
    path = tmp_path_factory.mktemp("turned") / "film.mp4"
    write_turned_film(path, (width, height), rate, count, degrees)
    video = Video(path)
    frames = list(video.frames())
    video.close()
    assert video.size == ((height, width) if degrees in (90, 270) else (width, height))
    assert [t for _, t, _ in frames] == pytest.approx(np.arange(count) / rate, abs=1e-3)
    for _, _, image in frames:
        assert image.shape[1::-1] == video.size
        corners = [image[4, 4], image[4, -5], image[-5, -5], image[-5, 4]]  # clockwise
        assert np.argmax([c.mean() for c in corners]) == degrees // 90
