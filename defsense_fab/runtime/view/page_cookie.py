"""The token of a page's link, kept in a cookie: the page opens its socket at an address without
the token, and a browser sends the cookie along."""

from __future__ import annotations

from http.cookies import CookieError, SimpleCookie
from typing import Any

from ...core.machine.local_access import Access


def refusal(access: Access, port: int, path: str, cookies: list[str]) -> str | None:
    """Why a request with this path and these Cookie headers is refused; None where it has the
    token in one of them, or none is needed."""
    if access.knows(path) or any(access.is_token(v) for v in _values(cookies, port)):
        return None
    return "open the link that `defsense studio` prints: it ends with the token"


def give(access: Access, port: int, headers: Any) -> None:
    """Put the token into an answer: for this page alone, unseen by scripts, never sent along from
    pages of others. Links that the page leads to do not tell it."""
    if access.token:
        headers["Set-Cookie"] = f"{_name(port)}={access.token}; Path=/; HttpOnly; SameSite=Strict"
        headers["Referrer-Policy"] = "no-referrer"


def _values(cookies: list[str], port: int) -> list[str]:
    out = []
    for text in cookies:
        try:
            found = SimpleCookie(text).get(_name(port))
        except CookieError:
            continue
        if found is not None:
            out.append(found.value)
    return out


def _name(port: int) -> str:
    """Cookies do not know ports: two pages of one machine would take each other's."""
    return f"defsense-{port}"
