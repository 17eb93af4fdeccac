"""Compile the sketches for the ATmega328P at 16 MHz, the simulated board and the golden check."""

import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).resolve().parent
FIRMWARE = HERE.parents[1] / "firmware"
LIBRARY = FIRMWARE / "DefSense"
ARDUINO = Path("/usr/share/arduino/hardware/arduino/avr")
SKETCHES = ("divider", "ads1115")
USES_WIRE = {"ads1115"}

# The flags of the Arduino IDE (platform.txt), and the Nano's variant, which has eight inputs.
COMMON = [
    *("-mmcu=atmega328p", "-DF_CPU=16000000L", "-DARDUINO=10819"),
    *("-DARDUINO_AVR_NANO", "-DARDUINO_ARCH_AVR", "-g", "-Os", "-flto"),
    *("-ffunction-sections", "-fdata-sections", "-fno-fat-lto-objects"),
]
C = ["avr-gcc", "-c", "-std=gnu11", *COMMON]
CXX = [
    *("avr-g++", "-c", "-std=gnu++11", *COMMON),
    *("-fpermissive", "-fno-exceptions", "-fno-threadsafe-statics"),
    "-DDECIMAL_DIG=__DECIMAL_DIG__",  # for WString.cpp; missing in this compiler's float.h
]
LINK = [
    *("avr-gcc", "-mmcu=atmega328p", "-w", "-Os", "-g", "-flto", "-fuse-linker-plugin"),
    "-Wl,--gc-sections",
]
STRICT = ["-Wall", "-Wextra", "-Werror"]
HOST_C = ["gcc", "-std=gnu11", "-O2", *STRICT]

# Required programs and files, and the Debian packages that have them.
REQUIRED = {
    "avr-gcc": "gcc-avr",
    "gcc": "gcc",
    "/usr/lib/avr/include/avr/io.h": "avr-libc",
    str(ARDUINO / "cores/arduino/Arduino.h"): "arduino-core-avr",
    "/usr/include/simavr/sim_avr.h": "libsimavr-dev",
    "/usr/include/libelf.h": "libelf-dev",
}


class BuildError(Exception):
    """Error with a compiler's message, or with the missing packages."""


def missing_packages() -> list[str]:
    """Return the missing Debian packages."""
    return [
        package
        for thing, package in REQUIRED.items()
        if not (Path(thing).exists() if thing.startswith("/") else shutil.which(thing))
    ]


def _run(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise BuildError(f"{' '.join(command)}\n{done.stdout}{done.stderr}")
    return done.stdout


def _prepare(folder: Path) -> None:
    if missing := missing_packages():
        raise BuildError(f"cannot build the firmware: apt-get install {' '.join(missing)}")
    folder.mkdir(parents=True, exist_ok=True)


def _compile(sources: list[Path], flags: list[str], folder: Path) -> list[str]:
    """Compile C, C++ and .ino sources, and return their object files."""
    folder.mkdir(exist_ok=True)

    def one(source: Path) -> str:
        target = folder / f"{source.name}.o"
        compiler = C if source.suffix == ".c" else CXX
        sketch = ["-x", "c++", "-include", "Arduino.h"] if source.suffix == ".ino" else []
        _run([*compiler, *flags, *sketch, str(source), "-o", str(target)])
        return str(target)

    with ThreadPoolExecutor() as pool:
        return list(pool.map(one, sources))


def _sources(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.suffix in (".c", ".cpp"))


def build_sketch(name: str, folder: Path) -> Path:
    """Compile an example as the Arduino IDE does, and return the .elf file."""
    _prepare(folder)
    objects = folder / f"{name}.objects"
    core, wire = ARDUINO / "cores/arduino", ARDUINO / "libraries/Wire/src"
    includes = [
        f"-I{path}"
        for path in (core, ARDUINO / "variants/eightanaloginputs", ARDUINO / "variants/standard")
    ]
    archive = objects / "core.a"
    core_objects = _compile(_sources(core), [*includes, "-w"], objects)
    _run(["avr-gcc-ar", "rcs", str(archive), *core_objects])
    libraries = []
    if name in USES_WIRE:
        includes += [f"-I{wire}", f"-I{wire / 'utility'}"]
        libraries = _compile(_sources(wire), [*includes, "-w"], objects)
    ours = [*_sources(LIBRARY / "src"), LIBRARY / "examples" / name / f"{name}.ino"]
    sketch = _compile(ours, [*includes, f"-I{LIBRARY / 'src'}", *STRICT], objects)
    elf = folder / f"{name}.elf"
    _run([*LINK, "-o", str(elf), *sketch, *libraries, str(archive), "-lm"])
    return elf


def build_board(folder: Path) -> Path:
    """Compile the simulated board, and return the program."""
    _prepare(folder)
    board = folder / "board"
    libraries = ["-lsimavr", "-lelf", "-lutil", "-lm"]
    _run([*HOST_C, str(HERE / "board.c"), "-o", str(board), *libraries])
    return board


def build_golden(folder: Path) -> Path:
    """Compile the check of the golden frames, and return the program."""
    _prepare(folder)
    golden = folder / "golden"
    frames = LIBRARY / "src"
    sources = [str(HERE / "golden.c"), str(frames / "defsense_frames.c")]
    _run([*HOST_C, "-std=c99", "-pedantic", f"-I{frames}", *sources, "-o", str(golden)])
    return golden
