"""Numbers of markers from the labels of files of other programs."""

from pathlib import Path

import pytest

from defsense_fab.capture.files.marker_labels import number_markers
from defsense_fab.core.errors import CaptureError
from tests.support.errors import raises


@pytest.mark.parametrize(
    ("labels", "ids", "columns"),
    [
        # Tags keep their numbers, whatever else is in the volume.
        (["tag_7", "tag_12"], [7, 12], [0, 1]),
        (["wand", "tag_7", "tag_3"], [7, 3], [1, 2]),
        (["tag_7", "tag_3", "*60"], [7, 3], [0, 1]),
        (["tag_7", "x7"], [7], [0]),
        (["bar:tag_7", "bar:tag_3", "bar:wand4"], [7, 3], [0, 1]),
        (["Tag_07", "TAG 8", "tag9", "tag_9b"], [7, 8, 9], [0, 1, 2]),
        (["tag_7", "tag_7*1", "stag_5", ""], [7], [0]),
        # Other labels that end in different numbers.
        (["a7", "b3"], [7, 3], [0, 1]),
        (["a7", "b3", "*60", "name*1", "Unlabeled 1001", "bar:*5", ""], [7, 3], [0, 1]),
        ([], [], []),
    ],
)
def test_numbers_are_those_of_the_labels(labels, ids, columns):
    result = number_markers(Path("a.c3d"), labels)
    assert result.ids.tolist() == ids
    assert result.columns.tolist() == columns
    assert not result.is_in_file_order or not labels
    left_out = [label for k, label in enumerate(labels) if k not in columns]
    assert len(result.notes) == bool(left_out)
    assert all(label in result.notes[0] for label in left_out)


@pytest.mark.parametrize(
    "labels", [["LASI", "M7"], ["M7", "N7"], ["*1", "*2"], ["", ""], ["a", "b*1"], ["M1", "wand"]]
)
def test_other_labels_are_numbered_in_the_order_of_the_file_with_a_note(labels):
    result = number_markers(Path("a.c3d"), labels)
    assert result.ids.tolist() == result.columns.tolist() == list(range(len(labels)))
    assert result.is_in_file_order
    assert all(label in result.notes[0] for label in labels)


@pytest.mark.parametrize("other", ["cube:tag_7", "tag_7", "TAG_007"])
def test_two_markers_of_one_tag_are_refused(other):
    with raises(CaptureError, "marker-repeated", marker=7, labels=("bar:tag_7", other)):
        number_markers(Path("a.c3d"), ["bar:tag_7", "wand", other])
