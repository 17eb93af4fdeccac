"""Prices that the user gives in `[prices]` of `device.toml`; the package has none."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated

from ..schema.declare import NonNegative, Problem, Table, key

_Price = NonNegative | None


@dataclass(frozen=True)
class Prices:
    """Prices of what a device is made from.

    Attributes:
        currency: Name of the currency.
        goods: Price per kg, m, 100 cm^2 or piece by the key of `[prices]`.
    """

    currency: str = ""
    goods: Mapping[str, float] = field(default_factory=dict)


class PricesTable(Table, frozen=True):
    """What you pay, for the cost in report and guide; what has no price is left out of it."""

    currency: Annotated[str, key("Name of the currency, such as `EUR`.", default="none")] = ""
    filament: Annotated[_Price, key("Material of the printed parts, per kg.", default="none")] = (
        None
    )
    silicone: Annotated[
        _Price, key("Silicone of cast parts, both components, per kg.", default="none")
    ] = None
    cord: Annotated[_Price, key("Cord, per m.", default="none")] = None
    wire: Annotated[_Price, key("Stranded wire, per m.", default="none")] = None
    ferrule: Annotated[_Price, key("A ferrule.", default="none")] = None
    resistor: Annotated[_Price, key("A reference resistor.", default="none")] = None
    glue: Annotated[_Price, key("Glue for faces of 100 cm^2.", default="none")] = None
    board: Annotated[_Price, key("The read-out board.", default="none")] = None
    converter: Annotated[_Price, key("A module with an ADS1115.", default="none")] = None

    def check(self) -> Iterator[Problem]:
        """Yield a problem if there are prices without a currency."""
        if self.record().goods and not self.currency.strip():
            text = "is missing, and there are prices"
            yield Problem(("currency",), text, "key-missing", 'Add it, as in currency = "EUR"')

    def record(self) -> Prices:
        """Return the prices that are given."""
        names = (name for name in self.__struct_fields__ if name != "currency")
        prices = {name: getattr(self, name) for name in names}
        return Prices(self.currency, {k: v for k, v in prices.items() if v is not None})
