"""Settings for slicing solids with conductive traces, and a call of PrusaSlicer."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from ...core.errors import FabricationError

#: Version of PrusaSlicer that slices with these settings were checked with.
CHECKED_VERSION = "2.5.0"
SLICER_TIMEOUT_S = 1800.0


@dataclass(frozen=True)
class TraceSettings:
    """Settings of a two-extruder printer that matter for traces.

    Temperatures, speeds and retraction are left to the user's profiles of filaments.

    Attributes:
        nozzle_mm: Diameters of the nozzles of both extruders, mm.
        filament_mm: Diameters of both filaments, mm.
        layer_mm: Layer height, mm.
        extruder_offset_mm: Offset (x, y) of the second nozzle, mm, if the printer's firmware does
            not handle it.
        bed_mm: Size (x, y) of the bed, mm.
        has_tower: Whether to print a tower on which the nozzles are wiped.
        shares_nozzle: Whether one nozzle prints both filaments, as with a filament changer.
    """

    nozzle_mm: tuple[float, float] = (0.4, 0.4)
    filament_mm: tuple[float, float] = (1.75, 1.75)
    layer_mm: float = 0.2
    extruder_offset_mm: tuple[float, float] = (0.0, 0.0)
    bed_mm: tuple[float, float] = (220.0, 220.0)
    has_tower: bool = False
    shares_nozzle: bool = False


def format_prusa_settings(settings: TraceSettings) -> str:
    """Return the settings as the text of an ini file for PrusaSlicer's option `--load`."""
    x, y = settings.bed_mm
    dx, dy = settings.extruder_offset_mm
    rows = {
        "gcode_flavor": "marlin2",
        "bed_shape": f"0x0,{x:g}x0,{x:g}x{y:g},0x{y:g}",
        "nozzle_diameter": ",".join(f"{v:g}" for v in settings.nozzle_mm),
        "extruder_colour": "#EBEBE1;#282828",  # body and traces in the slicer's pictures
        "filament_diameter": ",".join(f"{v:g}" for v in settings.filament_mm),
        "extruder_offset": f"0x0,{dx:g}x{dy:g}",
        "single_extruder_multi_material": int(settings.shares_nozzle),
        "wipe_tower": int(settings.has_tower),
        "toolchange_gcode": "",
        "use_relative_e_distances": 1,
        "layer_gcode": "G92 E0",  # required with relative distances
        "gcode_comments": 0,
        "layer_height": f"{settings.layer_mm:g}",
        "first_layer_height": f"{settings.layer_mm:g}",
        "fill_density": "100%",
        "fill_pattern": "rectilinear",
        "elefant_foot_compensation": 0,
        "clip_multipart_objects": 1,
        "wipe_into_infill": 0,
        "wipe_into_objects": 0,
        "skirts": 1,
    }
    return "".join(f"{key} = {value}\n" for key, value in rows.items())


def write_prusa_settings(settings: TraceSettings, path: Path) -> None:
    """Write the settings as an ini file for PrusaSlicer's option `--load`."""
    path.write_text(format_prusa_settings(settings), encoding="utf-8")


def slice_with_prusa(
    model: Path, settings: Path, gcode: Path, program: str = "prusa-slicer"
) -> tuple[str, ...]:
    """Slice a 3MF file with PrusaSlicer, at the place in the file.

    Args:
        model: 3MF file.
        settings: Ini file.
        gcode: G-code file to write.
        program: Name or path of the program.

    Returns:
        Warnings, such as an unchecked version of the program.

    Raises:
        FabricationError: The program is missing, fails, or writes no G-code.
    """
    executable = shutil.which(program)
    if executable is None:
        raise FabricationError(
            "is not installed",
            code="slicer-missing",
            where=program,
            action="Install PrusaSlicer, or slice the file in another slicer and check its G-code",
        )
    command = [executable, "--load", str(settings), "--export-gcode", "--dont-arrange"]
    try:
        process = subprocess.run(
            [*command, "--output", str(gcode), str(model)],
            capture_output=True,
            text=True,
            check=False,
            timeout=SLICER_TIMEOUT_S,
        )
    except subprocess.TimeoutExpired as error:
        raise FabricationError(
            f"took more than {SLICER_TIMEOUT_S:g} s",
            code="slicer-timeout",
            where=model,
            action="Slice the file in the slicer's window",
        ) from error
    if process.returncode != 0 or not gcode.is_file():
        message = (process.stderr.strip() or process.stdout.strip()).splitlines()
        raise FabricationError(
            f"cannot be sliced ({message[-1] if message else 'no message'})",
            code="slicing-failed",
            where=model,
            action="Open the file in the slicer to see the reason",
        )
    with gcode.open(encoding="utf-8", errors="replace") as file:
        first = file.readline()
    version = re.search(r"PrusaSlicer ([\w.+-]+)", first)
    if version and version[1].startswith(CHECKED_VERSION):
        return ()
    name = version[1] if version else "unknown"
    return (f"{program}: version {name} was not checked, {CHECKED_VERSION} was.",)
