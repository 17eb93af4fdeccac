"""The table `[prices]` of `device.toml`."""

import pytest

from defsense_fab.core.device.device_file import load_device, parse_device
from defsense_fab.core.errors import DeviceError
from tests.support.errors import raises
from tests.support.places import BAR, DEVICES

TEXT = (BAR / "device.toml").read_text("utf-8")


def with_prices(lines):
    return parse_device(f"{TEXT}\n[prices]\n{lines}\n", BAR).prices


@pytest.mark.parametrize("name", sorted(p.parent.name for p in DEVICES.glob("*/device.toml")))
def test_no_prices_are_shipped(name):
    assert not load_device(DEVICES / name).prices.goods


def test_prices_are_those_that_are_given():
    prices = with_prices('currency = "EUR"\ncord = 4.5\nferrule = 0')
    assert (prices.currency, prices.goods) == ("EUR", {"cord": 4.5, "ferrule": 0.0})
    assert not with_prices("").goods


@pytest.mark.parametrize(
    ("lines", "code", "key"),
    [
        ("cord = 4.5", "key-missing", "prices.currency"),
        ('currency = "EUR"\ncord = -1', "out-of-range", "prices.cord"),
        ('currency = "EUR"\ncord = "4.5"', "value-type", "prices.cord"),
        ('currency = "EUR"\nferules = 1', "key-unknown", "prices.ferules"),
    ],
)
def test_invalid_prices_are_refused(lines, code, key):
    with raises(DeviceError, code, key=key):
        with_prices(lines)
