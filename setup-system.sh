#!/bin/sh
# The CAD kernels and the picture renderer load libGL.so.1, and setup.py needs a C compiler and the headers
# of Python; bare Debian and Ubuntu lack them.
# "setup-system.sh test" also installs the AVR compiler and simulator and npm for the tests of the firmware, a browser
# for those of the studio and Graphviz for those of the wiring, which are skipped without them.
set -eu
[ "$(uname -s)" = Linux ] || exit 0
PATH="$PATH:/sbin:/usr/sbin"
needed="" wanted=""
for pair in libGL.so.1:libgl1 libXrender.so.1:libxrender1 libEGL.so.1:libegl1; do
    ldconfig -p | grep -q "${pair%%:*}" || needed="$needed ${pair##*:}"
done
command -v cc >/dev/null && [ -e /usr/include/stdio.h ] || needed="$needed gcc libc6-dev"
"${PYTHON:-python3}" -c "import os, sysconfig as s; os.stat(s.get_path('include') + '/Python.h')" 2>/dev/null ||
    needed="$needed python3-dev"
if [ "${1:-}" = test ]; then
    for pair in /usr/bin/avr-gcc:gcc-avr \
        /usr/lib/avr/include/avr/io.h:avr-libc /usr/share/arduino/hardware/arduino/avr:arduino-core-avr \
        /usr/include/simavr/sim_avr.h:libsimavr-dev /usr/include/libelf.h:libelf-dev \
        /usr/bin/chromium:chromium /usr/bin/dot:graphviz; do
        [ -e "${pair%%:*}" ] || wanted="$wanted ${pair##*:}"
    done
    command -v npm >/dev/null || wanted="$wanted nodejs npm"
fi
[ -n "$needed$wanted" ] || exit 0
if command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
    apt_get="apt-get"
elif command -v apt-get >/dev/null && command -v sudo >/dev/null && sudo -n true 2>/dev/null; then
    apt_get="sudo apt-get"
elif [ -n "$needed" ]; then
    echo "Packages of the system are missing. Type:  sudo apt-get install$needed" >&2
    exit 1
else
    echo "Tests of the firmware, in a browser or with Graphviz will be skipped. For them type:  sudo apt-get install$wanted" >&2
    exit 0
fi
$apt_get update -q
[ -z "$needed" ] || $apt_get install -y -q --no-install-recommends $needed
[ -z "$wanted" ] || $apt_get install -y -q --no-install-recommends $wanted ||
    echo "Tests of the firmware, in a browser or with Graphviz will be skipped: not installed:$wanted" >&2
