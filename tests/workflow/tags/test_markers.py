"""Places of a device's tags, and the sheets to print."""

import json
from dataclasses import replace

import cv2
import igl
import numpy as np
import pypdfium2
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from defsense_fab.capture.tags.tag_patterns import dictionary
from defsense_fab.core.device.device_file import load_device
from defsense_fab.core.errors import CaptureError
from defsense_fab.core.markers import Markers, read_markers, write_markers_file
from defsense_fab.core.mesh import Surface
from defsense_fab.geometry.bodies import tag_placement
from defsense_fab.geometry.bodies.tag_placement import are_spread_out
from defsense_fab.geometry.kernels.cutting_tools import upright_axes
from defsense_fab.geometry.printing.export import write_stl
from defsense_fab.store.manifest import Manifest, TagSeat, save_manifest
from defsense_fab.workflow.tags import marker_pages
from defsense_fab.workflow.tags import markers as module
from defsense_fab.workflow.tags.markers import write_markers
from defsense_fab.workflow.tags.options import MarkerOptions
from tests.support.errors import raises

pytestmark = pytest.mark.slow

DEVICE = """
name = "box"
[body]
mesh = "box.stl"
[material]
name = "ninjaflex-85a"
[mesh]
edge_length = 6.0
[regions]
base = {{ half_space = {{ origin = [12, 0, 0], normal = [-1, 0, 0] }} }}
[outputs]
{anchor}
[cord]
name = "rubber-2mm"
[fabrication]
process = "fdm-tpu"
{seats}
"""


SIZE = 12.0  # of tags that fit on the box below


def subdivided(surface, times):
    for _ in range(times):
        surface = Surface(*igl.upsample(surface.vertices, surface.faces))
    return surface


@pytest.fixture(scope="module")
def box():
    from tests.conftest import box_surface

    return subdivided(box_surface([0, -20, -15], [80, 20, 15]), 2)


@pytest.fixture
def make(box, tmp_path):
    def device(anchor='anchor = "base"', seats="", surface=box):
        folder = tmp_path / "box"
        folder.mkdir()
        write_stl(surface, folder / "box.stl")
        (folder / "device.toml").write_text(DEVICE.format(anchor=anchor, seats=seats))
        return load_device(folder, complete=False)

    return device


@pytest.fixture
def undrawn(monkeypatch):
    """Draw no pictures, which take seconds."""
    monkeypatch.setattr(marker_pages, "draw_places", lambda *_: None)


def check_places(markers, surface, tags):
    """Check that tags are on the skin, face outwards, and keep their white margins free."""
    edge = np.linspace(-0.5, 0.5, 21) * markers.size
    grid = np.stack(np.meshgrid(edge, edge), axis=-1).reshape(-1, 2)
    on = markers.centers[:, None] + np.einsum("gk,mjk->mgj", grid, markers.axes[:, :, :2])
    off = igl.point_mesh_squared_distance(on.reshape(-1, 3), surface.vertices, surface.faces)[0]
    assert np.sqrt(np.max(off)) < 1.0
    out = markers.centers + 2.0 * markers.axes[:, :, 2]
    assert (igl.fast_winding_number(surface.vertices, surface.faces, out) < 0.5).all()
    inner = markers.centers - 2.0 * markers.axes[:, :, 2]
    assert (igl.fast_winding_number(surface.vertices, surface.faces, inner) > 0.5).all()
    piece = markers.size * (tags.cells + 4) / (tags.cells + 2)
    points = markers.centers[:, None] + piece / markers.size * (on - markers.centers[:, None])
    for i in range(len(points)):
        local = (points - markers.centers[i]) @ markers.axes[i]
        under = (np.abs(local[..., :2]) < piece / 2 - 0.4).all(-1)  # rims overhang a little
        under &= np.abs(local[..., 2]) < 1.5
        assert not under[np.arange(len(points)) != i].any()


def with_seats(seats):
    """Return a manifest with seats only."""
    return Manifest(
        "box", "mm", (), (), (), (), "held", (), (), tuple(seats), (), None, 0.0, 1.0, warnings=()
    )


def test_a_device_gets_its_tags(make, box):
    device = make()
    files = write_markers(device)
    markers = read_markers(device.source / "markers")
    assert files.folder == device.source / "markers"
    assert markers.ids.tolist() == list(range(1, 13))
    assert markers.size == SIZE
    check_places(markers, box, dictionary("4X4_50"))
    assert (markers.anchor == (markers.centers[:, 0] < 12 - 0.25 * SIZE)).all()
    assert are_spread_out(markers.centers[markers.anchor], SIZE / 2)
    assert markers.centers[~markers.anchor, 0].max() > 60
    assert files.notes == ()
    with pypdfium2.PdfDocument(str(files.folder / "markers.pdf")) as sheets:
        assert len(sheets) >= 2
        table = sheets[len(sheets) - 1]
        text = table.get_textpage()
        assert "Center (x, y, z), mm" in text.get_text_bounded()
        text.close()
        table.close()


def test_pictures_together_show_every_tag_upright(make, box, undrawn):
    markers = write_markers(make(), MarkerOptions(count=8)).markers
    chosen = marker_pages.choose_views(box, markers)
    assert 2 <= len(chosen) <= 4
    assert np.any([visible for _, visible in chosen], axis=0).all()
    view, visible = chosen[0]
    png = np.frombuffer(marker_pages.draw_picture(box, markers, view, visible), np.uint8)
    image = cv2.resize(cv2.imdecode(png, cv2.IMREAD_GRAYSCALE), None, fx=2, fy=2)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary("4X4_50").table).detectMarkers(image)
    assert set(ids.ravel()) <= set(markers.ids[visible].tolist())  # not mirrored, nor another
    assert len(ids) >= visible.sum() - 1  # a number may touch a tag
    right = np.cross([0, 0, 1.0], view)
    for number, corner in zip(ids.ravel(), corners, strict=True):
        axes = markers.axes[markers.ids == number][0]
        drawn = corner[0][1] - corner[0][0]
        expected = [axes[:, 0] @ right, -axes[:, 0] @ np.cross(view, right)]
        assert drawn @ expected > 0.9 * np.linalg.norm(drawn) * np.linalg.norm(expected)


@settings(max_examples=2, deadline=None)
@given(st.integers(1, 16), st.sampled_from(["4X4_50", "APRILTAG_36H11"]), st.integers(0, 99))
def test_tags_on_a_curved_body(count, family, seed):
    # An ellipsoid: no face of it is flat.
    from tests.conftest import box_surface

    ball = subdivided(box_surface([-1, -1, -1], [1, 1, 1]), 3)
    unit = ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    stretch = np.random.default_rng(seed).uniform(35, 70, 3)
    body = Surface(unit * stretch, ball.faces)
    tags = dictionary(family)
    request = module.TagRequest(
        count, 10.0, module.piece_size(tags, 10.0), 3, lambda p: p[:, 2] < 0, np.zeros((0, 3)), []
    )
    places = module.place_tags(body, request)
    assert len(places) == count
    assert sum(p.anchor for p in places) >= min(3, count)
    markers = Markers(
        "ball",
        family,
        10.0,
        np.arange(count),
        np.array([p.center for p in places]),
        np.array([p.axes for p in places]),
        np.array([p.anchor for p in places]),
    )
    check_places(markers, body, tags)


def test_tags_avoid_the_ends_of_cords(make, box):
    end = np.array([40.0, 0, 15])
    request = module.TagRequest(20, 8.0, 10.7, 0, lambda p: np.zeros(len(p), bool), end[None], [])
    places = module.place_tags(box, request)
    assert len(places) == 20
    for p in places:
        local = (end - p.center) @ p.axes
        assert np.abs(local[:2]).max() > 5.3 or abs(local[2]) > 5


def test_an_anchor_without_room_is_reported(make, undrawn):
    device = make()
    files = write_markers(device, MarkerOptions(size=20.0, count=8))
    assert files.markers.size == 20.0
    (note,) = files.notes
    assert "anchor base" in note


def test_no_anchor(make, undrawn):
    files = write_markers(make(anchor=""), MarkerOptions(dictionary="36h11"))
    assert files.markers.dictionary == "APRILTAG_36H11"
    assert not files.markers.anchor.any()
    assert "all tags in the rest pose" in files.notes[0]


def test_seats_have_priority(make, undrawn):
    device = make(seats="marker_seats = 2")
    with raises(CaptureError, "tag-seats-not-built"):
        write_markers(device)
    (device.source / "build" / "parts").mkdir(parents=True)
    seats = [
        TagSeat(k + 1, np.array([10.0 + 50 * k, 0, 14]), np.eye(3)[1], np.eye(3)[2], 10.0)
        for k in range(2)
    ]
    save_manifest(device.source / "build", with_seats(seats))
    files = write_markers(device)
    assert files.markers.size == 7.5  # with a white cell on both sides 10 mm
    assert files.markers.anchor.tolist() == [True, False]
    assert files.markers.axes[0] == pytest.approx(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]))
    with raises(CaptureError, "tag-seats-given", count=2):
        write_markers(device, MarkerOptions(count=5))
    assert len(write_markers(device, MarkerOptions(count=5, skin=True)).markers.ids) == 5
    seats[0] = replace(seats[0], center=np.array([10.0, 0, 40]))
    save_manifest(device.source / "build", with_seats(seats))
    with raises(CaptureError, "tag-seats-outdated") as caught:
        write_markers(device)
    assert caught.value.data["distance"] == pytest.approx(25)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"size": 22.0}, "tags-do-not-fit"),
        ({"size": 60.0}, "tags-do-not-fit"),
        ({"count": 45, "size": 15.0}, "tags-do-not-fit"),
        ({"count": 50}, "out-of-range"),
        ({"count": 0}, "out-of-range"),
        ({"size": -3.0}, "out-of-range"),
        ({"dictionary": "8X8_50"}, "unknown-tag-dictionary"),
        ({"paper": "a7"}, "unknown-paper"),
        ({"side": (0.0, 0.0, 0.0)}, "direction-invalid"),
        ({"side": (np.nan, 0.0, 1.0)}, "direction-invalid"),
    ],
)
def test_impossible_tags_are_refused(make, undrawn, options, code):
    device = make()
    with raises(CaptureError, code):
        write_markers(device, MarkerOptions(**options))
    assert not (device.source / "markers" / "markers.json").exists()


def test_markers_are_read_back(tmp_path):
    axes = np.stack([np.eye(3), np.eye(3)[:, [1, 2, 0]]])
    m = Markers("d", "4X4_50", 12.0, np.array([3, 9]), np.eye(3)[:2], axes, np.array([True, False]))
    write_markers_file(m, tmp_path / "markers.json")
    back = read_markers(tmp_path / "markers.json")
    assert all(np.array_equal(getattr(back, k), v) for k, v in vars(m).items())
    assert m.corners[0] == pytest.approx(
        np.array([[-5, 6, 0], [7, 6, 0], [7, -6, 0], [-5, -6, 0.0]])
    )
    good = json.loads((tmp_path / "markers.json").read_text("utf-8"))
    tag = good["tags"][0]
    for change, code in (
        ({"schema": 9}, "wrong-schema"),
        ({"tags": []}, None),
        ({"tags": [{**tag, "center": [1, 2]}]}, "wrong-shape"),
        ({"tags": [{**tag, "axes": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}]}, "marker-axes-invalid"),
        ({"tags": [tag, tag]}, "marker-repeated"),
        ({"tags": [{**tag, "id": 1.5}]}, "marker-id-invalid"),
        ({"tags": [{**tag, "anchor": 1}]}, "not-a-bool"),
        ({"tags": [{"id": 1}]}, "key-missing"),
        ({"tags": 5}, "marker-file-invalid"),
        ({"size": "x"}, None),
        ({"size": -1}, "marker-size-invalid"),
    ):
        (tmp_path / "markers.json").write_text(json.dumps({**good, **change}))
        with pytest.raises(CaptureError) as caught:
            read_markers(tmp_path)
        assert code in (None, caught.value.code)
        assert "markers.json" in caught.value.where
    with pytest.raises(CaptureError):
        read_markers(tmp_path / "other.json")


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_many_tags_are_upright_like_one(seed):
    normals = np.random.default_rng(seed).standard_normal((5, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert tag_placement.upright_axes_of(normals) == pytest.approx(
        np.array([upright_axes(n) for n in normals])
    )
