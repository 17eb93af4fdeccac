"""Statuses and tables of the page."""

from __future__ import annotations

import pytest

from defsense_fab.core.errors import StorageError
from defsense_fab.studio.workbench.page_texts import StatusText, escape_cell, markdown_table


@pytest.mark.parametrize(
    ("error", "task", "code"),
    [
        (StorageError("is full", code="disk-full", where="the disk"), "The job", "disk-full"),
        (ZeroDivisionError("no"), "The job", "task-failed"),
        (ZeroDivisionError("no"), "", "task-failed"),
    ],
)
def test_a_status_has_the_code_of_its_error_until_the_next_text(error, task, code):
    status = StatusText()
    status.show_error(error, task)
    assert (status.code, status.error) == (code, error)
    assert str(error) in status.text
    status.show("ready")
    assert (status.text, status.code, status.error) == ("ready", "", None)


def test_the_last_alignment_of_a_table_holds_for_all_further_columns():
    lines = markdown_table(["a", "b", "c"], [["1", "2", escape_cell("x|<y>")]], "lr").splitlines()
    assert lines == ["| a | b | c |", "| --- | ---: | ---: |", "| 1 | 2 | x\\|&lt;y&gt; |"]
