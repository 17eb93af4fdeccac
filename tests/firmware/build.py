"""Compile the sketches for the ATmega328P at 16 MHz, boot loaders, the simulated board and a check.

`python -m tests.firmware.build` writes the images that come with the package again
(firmware/README.md). It refuses other versions of the tools, unless `--any-version` is given.
"""

import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from defsense_fab.capture.boards.images import IMAGES_FOLDER

HERE = Path(__file__).resolve().parent
FIRMWARE = HERE.parents[1] / "firmware"
LIBRARY = FIRMWARE / "DefSense"
ARDUINO = Path("/usr/share/arduino/hardware/arduino/avr")
SKETCHES = ("divider", "ads1115")
USES_WIRE = {"ads1115"}
# Variants of the boards, of which the first one found has each header. The Nano has eight inputs.
VARIANTS = {"nano": ("eightanaloginputs", "standard"), "uno": ("standard",)}
# Images in the package, with their sketches and boards. Those of the sketch ads1115 are the same
# for both boards.
IMAGES = {
    "divider-nano": ("divider", "nano"),
    "divider-uno": ("divider", "uno"),
    "ads1115": ("ads1115", "nano"),
}
# Boot loaders, and the addresses at which they start.
BOOT_LOADERS = {"optiboot": "7c00", "atmegaboot": "7800"}
# Versions with which the images in the package are compiled; others give other bytes.
COMPILER, CORE = "5.4.0", "1.8.7"

# The flags of the Arduino IDE (platform.txt).
COMMON = [
    *("-mmcu=atmega328p", "-DF_CPU=16000000L", "-DARDUINO=10819"),
    *("-DARDUINO_ARCH_AVR", "-g", "-Os", "-flto"),
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


def build_sketch(name: str, folder: Path, board: str = "nano", library: Path = LIBRARY) -> Path:
    """Compile an example as the Arduino IDE does, and return the .elf file.

    The code depends on the sources and on the versions of the compiler and the core only, not on
    the folder.
    """
    _prepare(folder)
    objects = folder / f"{name}.objects"
    core, wire = ARDUINO / "cores/arduino", ARDUINO / "libraries/Wire/src"
    flags = [f"-DARDUINO_AVR_{board.upper()}", f"-I{core}"]
    flags += [f"-I{ARDUINO / 'variants' / variant}" for variant in VARIANTS[board]]
    archive = objects / "core.a"
    core_objects = _compile(_sources(core), [*flags, "-w"], objects)
    archive.unlink(missing_ok=True)
    _run(["avr-gcc-ar", "rcs", str(archive), *core_objects])
    libraries = []
    if name in USES_WIRE:
        flags += [f"-I{wire}", f"-I{wire / 'utility'}"]
        libraries = _compile(_sources(wire), [*flags, "-w"], objects)
    ours = [*_sources(library / "src"), library / "examples" / name / f"{name}.ino"]
    sketch = _compile(ours, [*flags, f"-I{library / 'src'}", *STRICT], objects)
    elf = folder / f"{name}.elf"
    _run([*LINK, "-o", str(elf), *sketch, *libraries, str(archive), "-lm"])
    return elf


def build_image(name: str, folder: Path, library: Path = LIBRARY) -> Path:
    """Compile an image of the package, and return the .hex file."""
    sketch, board = IMAGES[name]
    elf, image = build_sketch(sketch, folder / name, board, library), folder / f"{name}.hex"
    _run(["avr-objcopy", "-O", "ihex", "-R", ".eeprom", str(elf), str(image)])
    return image


def differing_versions() -> list[str]:
    """Return the tools whose versions differ from those that compiled the package's images."""
    compiler = _run(["avr-gcc", "-dumpversion"]).strip()
    lines = (ARDUINO / "platform.txt").read_text("utf-8").splitlines()
    core = next(line.partition("=")[2] for line in lines if line.startswith("version="))
    return [
        f"{name} {found}, not {expected}"
        for name, found, expected in (
            ("avr-gcc", compiler, COMPILER),
            ("Arduino core", core, CORE),
        )
        if found != expected
    ]


def build_bootloader(name: str, folder: Path) -> Path:
    """Prepare a boot loader of the Arduino core for the simulated board.

    Args:
        name: A key of `BOOT_LOADERS`.
        folder: Folder for the files.

    Returns:
        The binary file.
    """
    _prepare(folder)
    binary, sources = folder / f"{name}.bin", ARDUINO / "bootloaders"
    if name == "atmegaboot":
        compiled = sources / "atmega/ATmegaBOOT_168_atmega328.hex"
        _run(["avr-objcopy", "-I", "ihex", "-O", "binary", str(compiled), str(binary)])
        return binary
    # Debian's compiled file has 532 bytes and is cut off at the end of the memory, where 512 are
    # left. The same source is linked 512 bytes further down.
    elf = folder / f"{name}.elf"
    flags = ["-Os", "-fno-split-wide-types", "-mrelax", "-mmcu=atmega328p", "-w", "-nostartfiles"]
    defines = ["-DF_CPU=16000000L", "-DLED_START_FLASHES=3", "-DBAUD_RATE=115200"]
    start = f"-Wl,--section-start=.text=0x{BOOT_LOADERS[name]}"
    places = [start, "-Wl,--section-start=.version=0x7ffe"]
    source = str(sources / "optiboot/optiboot.c")
    _run(["avr-gcc", *flags, *defines, *places, "-Wl,--relax", source, "-o", str(elf)])
    parts = ["-j", ".text", "-j", ".version"]
    _run(["avr-objcopy", "-O", "binary", *parts, str(elf), str(binary)])
    return binary


def build_board(folder: Path) -> Path:
    """Compile the simulated board, and return the program."""
    _prepare(folder)
    board = folder / "board"
    libraries = ["-lsimavr", "-lelf", "-lutil", "-lm"]
    sources = [str(HERE / name) for name in ("board.c", "board_inputs.c")]
    _run([*HOST_C, *sources, "-o", str(board), *libraries])
    return board


def build_golden(folder: Path) -> Path:
    """Compile the check of the golden frames, and return the program."""
    _prepare(folder)
    golden = folder / "golden"
    frames = LIBRARY / "src"
    sources = [str(HERE / "golden.c"), str(frames / "defsense_frames.c")]
    _run([*HOST_C, "-std=c99", "-pedantic", f"-I{frames}", *sources, "-o", str(golden)])
    return golden


def main() -> None:
    """Write the images that come with the package again."""
    versions = differing_versions()
    if versions and "--any-version" not in sys.argv[1:]:
        raise BuildError(f"other versions give other images: {', '.join(versions)}")
    IMAGES_FOLDER.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for name in IMAGES:
            shutil.copy(build_image(name, Path(folder)), IMAGES_FOLDER)
            print(f"{IMAGES_FOLDER / name}.hex")


if __name__ == "__main__":
    main()
