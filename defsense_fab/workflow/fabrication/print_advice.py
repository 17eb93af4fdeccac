"""How to print, as sentences: by the process, and by what it makes."""

from __future__ import annotations

from ...core.device.device import Device

_KINDS = {
    "fdm": "filament", "polyjet": "jets", "sla": "resin", "sls": "powder", "cast": "mould",
}  # fmt: skip


def print_advice(device: Device) -> list[str]:
    """Sentences for the maker, the most important first."""
    f = device.fabrication
    kind = _KINDS.get(f.process.split("-")[0])  # of a row that somebody added, maybe none
    if f.kind == "cast":
        return _moulds(device)
    walls = round(f.wall / f.line)
    out = [
        "Print every part as it lies on its plate, on its cut face unless a note tells another"
        " side: grooves need no supports."
    ]
    if kind == "filament":
        out += [
            f"Take {walls} wall lines of {f.line:g} mm, layers of {f.layer:g} mm and 100 % infill:"
            " the prediction is that of solid parts.",
            "Switch supports off, and painted or automatic supports in grooves and sockets with"
            " them: what stays of them narrows the channels.",
            "Dry the filament, print slowly (20 to 30 mm/s) and without a jump over grooves where"
            " the slicer can avoid it: strings in a groove hold a cord.",
        ]
        if "bowden" in f.process:
            out.append(
                "A Bowden extruder strings more: retract 3 to 5 mm slowly, and clear the grooves"
                " with a piece of wire of the channel's diameter."
            )
    elif kind == "jets":
        out += [
            "Choose the matte finish: a glossy one puts support on some sides only, and grooves"
            " come out unequal.",
            "Support fills grooves, pockets and sockets: wash it out with a water jet and push a"
            " rod of the cord's diameter through every groove before anything is closed.",
        ]
    elif kind == "resin":
        out += [
            "Tilt parts only if your printer cannot print them flat on the plate, and then put no"
            " supports into grooves, pockets and sockets; keep supports on the skin.",
            "Wash grooves and sockets with a syringe and blow them out before the parts are cured:"
            " resin that stays in them cures there.",
        ]
    elif kind == "powder":
        out += [
            "Orientation is free in powder; ask the service to blow powder out of grooves, pockets"
            " and sockets, and tell it not to infiltrate or smooth the parts by vapour: that"
            " changes their stiffness and the channels.",
        ]
    narrow = device.channel_diameter
    if f.hole > narrow:
        out.append(
            f"The channels of {narrow:.1f} mm are narrower than the {f.hole:g} mm that stay open in"
            " this process: they are grooves until the parts are closed, so clear each of them."
        )
    return out


def _moulds(device: Device) -> list[str]:
    f = device.fabrication
    resin = f.process.endswith("resin")
    out = [
        "Print every piece of the moulds as it lies on its plate, cores and cavities up, in a rigid"
        f" {'resin' if resin else 'plastic such as PLA or PETG'}: none of them needs supports.",
    ]
    if resin:
        out.append(
            "Wash and cure the moulds fully, then seal them: platinum silicone stays sticky on"
            " resin that is not cured. Three coats of clear acrylic lacquer, or a day at 60 degrees"
            " after curing, are usual; try a spoonful on a scrap first."
        )
    else:
        out.append(
            f"Take {max(3, round(1.2 / f.line))} wall lines of {f.line:g} mm, layers of"
            f" {min(f.layer, 0.12):g} mm and 20 % infill: silicone shows every layer, and leaks"
            " through pieces of one wall."
        )
    out.append(
        "Pins are printed with the moulds, in the same rigid plastic: they only align the parts."
        " Leave them out where they would be felt."
    )
    return out
