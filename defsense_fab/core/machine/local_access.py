"""Who may use what listens here: pages of this machine, and whoever has the token."""

from __future__ import annotations

import secrets
from urllib.parse import parse_qs, urlsplit

#: Names of this machine for itself.
LOCAL = ("127.0.0.1", "localhost", "::1")


class Access:
    """On this machine alone no token is needed, but browsers lend themselves to foreign pages: the
    `Origin` that they tell must be this machine's, and the `Host` that they asked for, too, as a
    foreign name may be made to lead here. Listening for other machines needs the token."""

    def __init__(self, host: str, token: str = "") -> None:
        """Of what listens at the address `host`, with a `token` of one's own."""
        self.local = host in LOCAL
        self.token = token or ("" if self.local else secrets.token_urlsafe(16))

    def refusal(self, host: str, origins: list[str]) -> str | None:
        """Why a request with these headers is refused; None where it is not."""
        if self.local and _name_of(f"//{host}") not in LOCAL:
            return f"this listens on this machine only, and not by the name {host[:80]!r}"
        for origin in origins:
            own = not self.local and origin.split("://", 1)[-1].lower() == host.lower()
            if _name_of(origin) not in LOCAL and not own:
                return f"pages of {origin[:80]!r} may not read this"
        return None

    def knows(self, path: str) -> bool:
        """Whether the path of a request has the token, or none is needed."""
        if not self.token:
            return True
        try:
            given = parse_qs(urlsplit(path).query).get("token", [""])
        except ValueError:
            return False
        return self.is_token(given[0])

    def is_token(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(errors="replace"), self.token.encode())


def _name_of(url: str) -> str:
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""
