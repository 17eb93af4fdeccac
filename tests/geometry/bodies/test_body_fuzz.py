"""Damaged files of bodies: a seeded few of those of `tests/support/body_fuzz.py`."""

import pytest

from tests.support.body_fuzz import built, mutated, outcome


@pytest.mark.slow
def test_damaged_files_are_read_or_refused_in_one_line(tmp_path):
    files = mutated(60, 7)[::15]
    for k, (name, content) in enumerate(files):
        folder = tmp_path / str(k)
        folder.mkdir()
        assert outcome(built(name, content, folder, 300)) != "fault", name
