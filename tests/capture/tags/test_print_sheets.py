"""Printed tags and boards have their true size, and OpenCV detects them."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pypdfium2
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from defsense_fab.capture.tags.print_sheets import (
    PAPERS,
    draw_tags,
    open_pdf,
    outlines,
    piece_size,
    write_board,
)
from defsense_fab.capture.tags.tag_patterns import (
    TAG_SHARE,
    CharucoBoard,
    dictionary,
    load_board,
    save_board,
)
from defsense_fab.core.errors import CaptureError, StorageError
from tests.support.errors import raises

DPI = 600
PX = DPI / 25.4  # in a mm


def rasters(path, shrunk=1.0):
    """Return the pages (h, w), 0 black; `shrunk` is the scale of a printer that fits them."""
    with pypdfium2.PdfDocument(str(path)) as document:
        pages = []
        for i in range(len(document)):
            page = document[i]
            bitmap = page.render(scale=shrunk * DPI / 72, grayscale=True)
            pages.append(bitmap.to_numpy().reshape(bitmap.height, bitmap.width).copy())
            bitmap.close()
            page.close()
        return pages


def detect_tags(image, family):
    """Return the corners (4, 2), px, by number, of the tags that OpenCV detects."""
    options = cv2.aruco.DetectorParameters()
    options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    options.cornerRefinementWinSize = 3
    step = 3
    small = cv2.resize(image, None, fx=1 / step, fy=1 / step, interpolation=cv2.INTER_AREA)
    corners, ids, _ = cv2.aruco.ArucoDetector(family.table, options).detectMarkers(small)
    if ids is None:
        return {}
    rough = {int(i): step * (c[0] + 0.5) - 0.5 for i, c in zip(ids.ravel(), corners, strict=True)}
    assert len(rough) == len(corners)
    return rough


def edges_of(image, corners, cells):
    """Return left, right, top and bottom, px, of an upright tag, from bands across its edges."""
    (left, top), (right, bottom) = corners.min(0) + 0.5, corners.max(0) + 0.5
    half = 0.5 * (right - left) / (cells + 2)

    def edge(picture, at, low, high, falls):
        a, b = round(at - half), round(at + half)
        black = (1 - picture[round(low) + 5 : round(high) - 5, a:b] / 255.0).mean(0).sum()
        return a + black if falls else b - black

    return (
        edge(image, left, top, bottom, False),
        edge(image, right, top, bottom, True),
        edge(image.T, top, left, right, False),
        edge(image.T, bottom, left, right, True),
    )


def ruler_length(strip):
    """Return the distance, px, between the outermost ticks of a strip (n,) of darkness."""
    on = np.flatnonzero(strip > 0.02)
    ends = [on[on < on[0] + 15], on[on > on[-1] - 15]]
    low, high = ((strip[e] * e).sum() / strip[e].sum() for e in ends)
    return high - low


def check_tags(pages, family, numbers, size):
    sizes = {}
    for image in pages:
        for number, corners in detect_tags(image, family).items():
            assert corners[0][1] < corners[2][1], "upright"
            assert number not in sizes
            left, right, top, bottom = edges_of(image, corners, family.cells)
            sizes[number] = right - left, bottom - top
    assert sorted(sizes) == sorted(numbers)
    for across, down in sizes.values():
        assert across / PX == pytest.approx(size, rel=1e-3)
        assert down / PX == pytest.approx(size, rel=1e-3)


def check_rulers(image):
    level, at = round(len(image) - 21.4 * PX), round(14.6 * PX)  # ticks of each 10 mm alone
    across = image[level - 4 : level + 4, round(20 * PX) : round(140 * PX)]
    down = image[round(len(image) - 140 * PX) : round(len(image) - 20 * PX), at - 4 : at + 4]
    for strip in (across, down.T):
        assert ruler_length((1 - strip / 255).mean(0)) / PX == pytest.approx(100, rel=1e-3)


def check_board(image, board):
    small = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    corners, ids, _, tags = cv2.aruco.CharucoDetector(board.charuco).detectBoard(small)
    assert len(tags) == board.columns * board.rows // 2
    assert ids.ravel().tolist() == list(range((board.columns - 1) * (board.rows - 1)))
    at = 2 * np.reshape(corners, (board.rows - 1, board.columns - 1, 2)) / PX
    step = np.stack([np.diff(at, axis=1)[..., 0].mean(), np.diff(at, axis=0)[..., 1].mean()])
    assert step == pytest.approx(board.square, rel=1e-3)
    for axis, along in ((1, 0), (0, 1)):
        gaps = np.diff(at, axis=axis)
        assert gaps[..., along] == pytest.approx(board.square, rel=1e-3)
        assert np.abs(gaps[..., 1 - along]).max() < 1e-3 * board.square


@pytest.fixture
def printed(tmp_path):
    def make(family, numbers, size, paper):
        path = tmp_path / "tags.pdf"
        with open_pdf(path, "tags") as canvas:
            draw_tags(canvas, family, numbers, size, paper, "device")
        return path

    return make


@pytest.mark.parametrize(
    ("name", "paper", "size", "count", "pages"),
    [("4X4_50", "a4", 12.0, 12, 1), ("36h11", "letter", 20.0, 45, 2)],
)
def test_tags_have_their_size(printed, name, paper, size, count, pages):
    family = dictionary(name)
    numbers = range(1, count + 1)
    path = printed(family, numbers, size, paper)
    drawn = rasters(path)
    assert len(drawn) == pages
    check_tags(drawn, family, numbers, size)
    check_rulers(drawn[0])
    assert drawn[0].shape == pytest.approx(np.array(PAPERS[paper])[::-1] * PX, abs=1)


def test_scaled_sheet_is_detected(printed):
    family = dictionary("4X4_50")
    (page,) = rasters(printed(family, [1, 2], 15.0, "a4"), shrunk=0.995)
    with pytest.raises(AssertionError):
        check_tags([page], family, [1, 2], 15.0)
    with pytest.raises(AssertionError):
        check_rulers(page)


def test_neighboring_cells_leave_no_hairlines(printed):
    family = dictionary("4X4_50")
    (page,) = rasters(printed(family, [7], 11.3, "a4"))
    ((number, corners),) = detect_tags(page, family).items()
    left, right, top, bottom = edges_of(page, corners, family.cells)
    pattern = family.pattern(number)
    x, y = (
        np.arange(np.ceil(left), right - 1, dtype=int),
        np.arange(np.ceil(top), bottom - 1, dtype=int),
    )
    kept = np.ones((2, len(y), len(x)), bool)
    for off in (-2, 3):  # px off the edges between black and white
        i = np.clip((6 * (y + off - top) / (bottom - top)).astype(int), 0, 5)
        for aside in (-2, 3):
            j = np.clip((6 * (x + aside - left) / (right - left)).astype(int), 0, 5)
            kept &= pattern[np.ix_(i, j)] == np.array([0, 255])[:, None, None]
    for value, where in zip((0, 255), kept, strict=True):
        assert where.sum() > 5000
        assert (page[np.ix_(y, x)][where] == value).all()


@pytest.mark.parametrize(
    ("board", "paper"), [(CharucoBoard(), "a4"), (CharucoBoard(5, 8, 22, 16, "36h11"), "letter")]
)
def test_board_has_its_size(tmp_path, board, paper):
    path = tmp_path / "board.pdf"
    write_board(board, path, paper)
    assert b"/PrintScaling /None" in path.read_bytes()
    (page,) = rasters(path)
    check_board(page, board)
    check_rulers(page)
    if paper == "a4":
        (page,) = rasters(path, shrunk=0.995)
        with pytest.raises(AssertionError):
            check_board(page, board)
        assert not detect_tags(page, dictionary("4X4_50"))  # the family of a device's tags
        assert not detect_tags(page, dictionary("36h11"))


@settings(max_examples=30, deadline=None)
@given(arrays(bool, st.tuples(st.integers(1, 6), st.integers(1, 6))))
def test_outlines_hold_the_black_cells(black):
    inside = np.zeros(black.shape, bool)
    for polygon in outlines(black):
        for (x0, y0), (x1, y1) in zip(polygon, [*polygon[1:], polygon[0]], strict=True):
            assert (x0 == x1) != (y0 == y1)
            if x0 == x1:  # a ray to the right crosses it
                inside[min(y0, y1) : max(y0, y1), :x0] ^= True
    assert (inside == black).all()


def test_board_is_read_back(tmp_path):
    board = CharucoBoard().measure(29.9)
    save_board(board, tmp_path / "board.json")
    assert load_board(tmp_path) == board
    assert json.loads((tmp_path / "board.json").read_text("utf-8"))["measured"] == 29.9
    assert board.charuco.getSquareLength() == pytest.approx(29.9)
    assert board.charuco.getMarkerLength() == pytest.approx(22 * 29.9 / 30)
    assert board.corners == pytest.approx(board.charuco.getChessboardCorners(), abs=1e-4)


@pytest.mark.parametrize(
    ("changed", "code"),
    [
        ({"rows": 2}, "board-too-small"),
        ({"square": float("nan")}, "out-of-range"),
        ({"marker": 29.0}, "board-tag-size-invalid"),
        ({"columns": 21, "rows": 11}, "board-needs-more-tags"),
        ({"measured": 20.0}, "print-scale-wrong"),
        ({"dictionary": "9X9_7"}, "unknown-tag-dictionary"),
    ],
)
def test_impossible_boards_are_rejected(changed, code):
    with raises(CaptureError, code):
        replace(CharucoBoard(), **changed)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("{", None),
        ("[]", "not-a-board-file"),
        ('{"schema": 2}', "not-a-board-file"),
        ('{"schema": 1}', "key-missing"),
        ({"colour": 1}, "unknown-key"),
        ({"columns": "7"}, "value-invalid"),
        ({"measured": "x"}, "value-invalid"),
    ],
)
def test_files_that_are_not_boards(tmp_path, text, code):
    path = tmp_path / "board.json"
    save_board(CharucoBoard(), path)
    if isinstance(text, dict):
        text = json.dumps({**json.loads(path.read_text("utf-8")), **text})
    path.write_text(text)
    with pytest.raises(CaptureError) as caught:
        load_board(path)
    assert code in (None, caught.value.code)
    with pytest.raises(CaptureError):
        load_board(tmp_path / "other.json")


def test_prints_that_do_not_fit_are_rejected(tmp_path, printed):
    with raises(CaptureError, "print-too-large", square=30):
        write_board(CharucoBoard(square=40, marker=round(40 * TAG_SHARE, 1)), tmp_path / "b.pdf")
    write_board(CharucoBoard(square=40, marker=round(40 * TAG_SHARE, 1)), tmp_path / "b.pdf", "A3")
    with raises(CaptureError, "unknown-paper", papers=("a4", "letter", "a3")):
        write_board(CharucoBoard(), tmp_path / "b.pdf", "legal")
    with raises(CaptureError, "print-too-large"):
        printed(dictionary("4X4_50"), [1], 150.0, "a4")
    with raises(CaptureError, "out-of-range", tag=50, count=50):
        printed(dictionary("4X4_50"), [50], 10.0, "a4")
    with pytest.raises(StorageError):
        write_board(CharucoBoard(), tmp_path / "none" / "b.pdf")
    assert [p.name for p in tmp_path.iterdir()] == ["b.pdf"]
    assert piece_size(dictionary("36h11"), 8.0) == pytest.approx(10.0)
