"""Libraries of the system that wheels do not bring, and what installs them."""

from __future__ import annotations

import sys

#: What draws and cuts loads, though there is no screen.
GRAPHICS = "sudo apt-get install libgl1 libegl1 libxrender1"
_PACKAGES = {
    "libGL.so": GRAPHICS,
    "libEGL.so": GRAPHICS,
    "libXrender.so": GRAPHICS,
    "libasound.so": "sudo apt-get install libasound2",
}


def system_command(trouble: str) -> str:
    """What to type where the `trouble` with an import is one of them; nothing for others, and on
    systems without apt."""
    if sys.platform != "linux":
        return ""
    return next((command for name, command in _PACKAGES.items() if name in trouble), "")
