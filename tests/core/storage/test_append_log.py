"""Test logs that are appended to by several threads, and read without damaged lines."""

import threading

from defsense_fab.core.errors import CaptureError, StorageError
from defsense_fab.core.storage.append_log import AppendLog, LogLines
from tests.support.errors import raises


def test_lines_of_several_threads_are_not_mixed(tmp_path):
    path = tmp_path / "log"
    with AppendLog(path, "head") as log:
        threads = [
            threading.Thread(target=lambda k=k: [log.line(f"{k} {n}") for n in range(300)])
            for k in range(4)
        ]
        for t in threads:
            t.start()
        for t in threads:
            t.join()
    lines = LogLines(path)
    numbers, texts = zip(*lines, strict=True)
    assert numbers == tuple(range(1, 1202))
    assert texts[0] == "head"
    for k in range(4):
        assert [t for t in texts if t.startswith(f"{k} ")] == [f"{k} {n}" for n in range(300)]
    assert lines.skipped == 0


def test_cut_and_damaged_lines_are_skipped_and_counted(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(b"one\r\n\ntw~\nth\0\0ree\nf\xffour\nfive\nsi")
    lines = LogLines(path)
    for _ in range(2):  # the counts start again each time
        assert list(lines) == [(1, "one"), (2, ""), (6, "five")]
        assert (lines.cut, lines.damaged, lines.skipped) == (2, 2, 4)
    with raises(CaptureError, "file-not-found", path=tmp_path / "none"):
        list(LogLines(tmp_path / "none"))


def test_log_continues_after_a_cut_line(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(b"head\none\ntw")
    with AppendLog(path, "head") as log:
        log.line("three\nfour")
    assert path.read_bytes() == b"head\none\ntw~\nthree\nfour\n"


def test_other_file_is_refused_and_unchanged(tmp_path):
    path = tmp_path / "log"
    for text in ("mine\n", "headlong\n", "he\n"):
        path.write_text(text)
        with raises(CaptureError, "wrong-file-format", file_kind="diary"):
            AppendLog(path, "head", "diary")
        assert path.read_text("utf-8") == text
    with raises(StorageError, "file-not-found", path=tmp_path / "none" / "log"):
        AppendLog(tmp_path / "none" / "log")


def test_closed_log_refuses_lines(tmp_path):
    log = AppendLog(tmp_path / "log")
    log.close()
    log.close()
    with raises(StorageError, "log-closed"):
        log.line("late")
    assert (tmp_path / "log").read_bytes() == b""
