"""Assertions on errors by their code and data, never by their wording."""

import pytest

from defsense_fab.core.errors import DefsenseError


def raises(kind, code, **data):
    """Expect an error of the class `kind` with this `code`, and at least these `data`.

    Use it as `with raises(CaptureError, "port-busy", port="COM3") as caught:`; `caught.value` is
    the error.
    """

    def matches(error):
        assert isinstance(error, DefsenseError)
        assert error.code == code, f"the code is {error.code!r}: {error}"
        found = {name: error.data.get(name) for name in data}
        assert found == data, f"the data are {error.data}: {error}"
        return True

    return pytest.raises(kind, check=matches)
