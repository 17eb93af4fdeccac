"""Limits of the values in a request: what no page sends, whatever the request."""

from __future__ import annotations

from typing import Any

from ...core.errors import DefsenseError
from ...workflow.view import Request
from ..messages.body import SetField, SetParameter
from ..messages.start import KeepPicture

#: Largest number in a request: products of a few coordinates in mm stay finite.
MAX_NUMBER = 1e9
MAX_NAME_CHARACTERS = 120
#: Largest number of characters of other texts, such as paths.
MAX_TEXT_CHARACTERS = 4096
#: Requests whose values are checked in their own words.
_CHECKED_BY_STEPS = (KeepPicture, SetField, SetParameter)


def check_values(request: Request) -> None:
    """Check the numbers and texts of a request.

    Raises:
        DefsenseError: A number is too large (`number-too-large`), or a text is too long
            (`text-too-long`).
    """
    for name in request.__struct_fields__:
        if name == "id":
            continue
        value = getattr(request, name)
        if not isinstance(request, _CHECKED_BY_STEPS):
            _check_numbers(name, value)
        if not isinstance(request, KeepPicture):
            _check_texts(name, value)


def _check_numbers(name: str, value: Any) -> None:
    if isinstance(value, list):
        for part in value:
            _check_numbers(name, part)
    elif isinstance(value, int | float) and not abs(value) <= MAX_NUMBER:
        raise DefsenseError(
            "a number is too large",
            code="number-too-large",
            where=name,
            action=f"Enter a number of at most {MAX_NUMBER:g}",
            field=name,
        )


def _check_texts(name: str, value: Any) -> None:
    limit = MAX_NAME_CHARACTERS if name == "name" else MAX_TEXT_CHARACTERS
    for text in value if isinstance(value, list) else [value]:
        if isinstance(text, str) and len(text) > limit:
            raise DefsenseError(
                f"a text of {len(text)} characters is too long",
                code="text-too-long",
                where=name,
                action=f"Enter at most {limit} characters",
                field=name,
            )
