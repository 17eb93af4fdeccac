#!/bin/sh
# The CAD kernels and the picture renderer load libGL.so.1, which bare Debian and Ubuntu lack.
set -eu
[ "$(uname -s)" = Linux ] || exit 0
PATH="$PATH:/sbin:/usr/sbin"
missing=""
for pair in libGL.so.1:libgl1 libXrender.so.1:libxrender1 libEGL.so.1:libegl1; do
    ldconfig -p | grep -q "${pair%%:*}" || missing="$missing ${pair##*:}"
done
[ -n "$missing" ] || exit 0
if command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
    apt-get update -q && apt-get install -y -q --no-install-recommends $missing
elif command -v apt-get >/dev/null && command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
    sudo apt-get update -q && sudo apt-get install -y -q --no-install-recommends $missing
else
    echo "System libraries are missing. Type:  sudo apt-get install$missing" >&2
    exit 1
fi
