"""The small bar with its model, as in the tests of the live loop."""

from tests.runtime.live.conftest import live_bar as live_bar_fixture
from tests.runtime.live.conftest import small_bar as small_bar_fixture

live_bar, small_bar = live_bar_fixture, small_bar_fixture
