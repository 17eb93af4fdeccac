"""Values that a hand is still changing."""

from __future__ import annotations

import threading

from defsense_fab.studio.workbench.settled import Settled

LONG = 60.0


def test_the_last_value_counts_once_the_hand_rests():
    seen, done = [], threading.Event()

    def work(values):
        seen.append(values)
        done.set()

    settled = Settled(work, seen.append, quiet=0.05)
    for value in range(5):
        settled.give("a", value)
    settled.give("b", 7)
    assert settled.pending("a")
    assert done.wait(LONG)
    assert seen == [{"a": 4, "b": 7}]
    assert not settled.pending("a")
    settled.close()


def test_nothing_is_lost_at_the_end_and_failures_are_told():
    failed = []

    def work(values):
        raise ValueError(values)

    settled = Settled(work, failed.append, quiet=LONG)
    settled.give("a", 1)
    settled.close()
    settled.flush()
    assert [str(e) for e in failed] == ["{'a': 1}"]
