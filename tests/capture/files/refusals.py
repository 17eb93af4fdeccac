"""Check that files of tracks are refused."""

import pytest

from defsense_fab.capture.files.formats import read_tracks
from defsense_fab.core.errors import CaptureError


def refused(path, code=None, **data):
    with pytest.raises(CaptureError) as error:
        read_tracks(path)
    assert code in (None, error.value.code)
    assert data == {name: error.value.data.get(name) for name in data}
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)
