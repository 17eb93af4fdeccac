"""What each key of `device.toml` means, and its unit: the words of the generated reference.

Type, default and limits are not here: the reference takes them from the reader as it checks files.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Key:
    """What a key means, as Markdown, and its unit; `kind` and `default` where the reader's words do
    not tell them: values of several types, and defaults that follow from other values."""

    meaning: str
    unit: str = ""
    kind: str = ""
    default: str = ""

    def __post_init__(self) -> None:
        if not self.meaning or self.meaning.endswith("."):
            raise ValueError(f"a phrase without a full stop is needed, not {self.meaning!r}")


_SIDE = "`[x, y, z]`"
_ONE_OF = "one of `script`, `step`, `mesh`"

#: By tables, as their headings are written, and by keys; inner tables of one line are dotted keys.
KEYS: Mapping[str, Mapping[str, Key]] = {
    "": {
        "schema": Key("version of this format", kind="whole number"),
        "name": Key("the device's name"),
        "body": Key("[the body](#body)"),
        "material": Key("[its material](#material)"),
        "mesh": Key("[its tetrahedra](#mesh)"),
        "regions": Key("[named parts of the body](#regions)"),
        "poses": Key("[what the device is to sense](#poses)", default="needed by a build"),
        "states": Key("[mixtures and fractions of the poses](#states)"),
        "outputs": Key("[what is read from the cords](#outputs)"),
        "cord": Key("[the conductive cord](#cord)"),
        "readout": Key("[what measures the cords](#readout)"),
        "fabrication": Key("[printer, parts and joints](#fabrication)"),
        "design": Key("[what is found automatically](#design)"),
        "sensors": Key("[cords that are drawn](#sensors); none where all are to be found"),
    },
    "[body]": {
        "script": Key(
            "a Python file beside `device.toml` that defines `body(**parameters)` and returns one"
            " build123d or CadQuery solid; it runs in a process of its own; `docs/studio.md` tells"
            " how it states bounds for the studio's sliders",
            default=_ONE_OF,
        ),
        "step": Key("a STEP file", default=_ONE_OF),
        "mesh": Key(
            "a mesh: STL, OBJ, PLY, OFF, 3MF, GLB, or tetrahedra in `.msh`, `.vtu` or `.mesh`; what"
            " is repaired: `docs/bodies.md`",
            default=_ONE_OF,
        ),
        "parameters": Key(
            "values for the script's `body`; `--set name=value` replaces one for one command"
        ),
        "scale": Key("of a mesh: the factor that turns its unit into mm"),
        "fill_cavities": Key(
            "`true` makes closed cavities solid; `false` refuses a body with one, and tells its"
            " volume and place"
        ),
        "time_limit": Key(
            "the longest that the script, or reading and repairing a file, may take; Ctrl-C stops"
            " it too",
            "s",
        ),
        "bay": Key("[a recess for a connector](#body-bay)", default="no bay"),
    },
    "[body.bay]": {
        "at": Key(
            "the point of the skin around which the bay opens; meshes, poses and cords keep to the"
            " body with it, and wires end in it (`docs/fabrication.md`)",
            "mm",
        ),
        "size": Key("width, height and depth", "mm"),
    },
    "[material]": {
        "name": Key(
            "a row of `defsense_fab/data/materials.csv`, whose columns say where each modulus comes"
            " from and what it was compared with; with values of your own any name",
            default='`"custom"`',
        ),
        "model": Key("the hyperelastic model"),
        "young_modulus": Key(
            "Young's modulus at small strain, in place of the row's; not with `shore`",
            "MPa",
            default="the row's",
        ),
        "shore": Key('hardness, as `"30A"`, in place of `young_modulus`', default="none"),
        "poisson_ratio": Key(
            "Poisson's ratio, above -1 and below 0.5", default="the row's; needed without one"
        ),
        "density": Key("for gravity and modes", "g/cm³", default="the row's, or 1.1"),
        "c10": Key(
            "of Mooney-Rivlin and Yeoh, in place of `young_modulus`",
            "MPa",
            default="needed by them",
        ),
        "c01": Key("of Mooney-Rivlin", "MPa"),
        "c20": Key("of Yeoh", "MPa"),
        "c30": Key("of Yeoh", "MPa"),
    },
    "[mesh]": {
        "edge_length": Key(
            "of the tetrahedra, shorter where the surface is curved; about a fifth of the thickness"
            " is enough",
            "mm",
            default="this or `accuracy`",
        ),
        "accuracy": Key(
            "in place of `edge_length`: relative accuracy of signals, as 0.01; poses are solved on"
            " finer and finer meshes until lines through the body change less, and `mesh.json` says"
            " what was reached",
            default="this or `edge_length`",
        ),
        "time_limit": Key("the longest that meshing may take, all its ways together", "s"),
    },
    "[regions]": {
        "NAME": Key("a region, by one of the shapes below; poses name it", kind="table"),
        "NAME.box": Key("`[[low], [high]]`: two corners", "mm"),
        "NAME.sphere": Key("`{ center, radius }`"),
        "NAME.sphere.center": Key("its middle", "mm"),
        "NAME.sphere.radius": Key("its radius", "mm"),
        "NAME.half_space": Key("`{ origin, normal }`: all on the side that `normal` points to"),
        "NAME.half_space.origin": Key("a point of its plane", "mm"),
        "NAME.half_space.normal": Key("direction, of any length but zero"),
        "NAME.cylinder": Key("`{ start, end, radius }`"),
        "NAME.cylinder.start": Key("one end of its axis", "mm"),
        "NAME.cylinder.end": Key("the other end", "mm"),
        "NAME.cylinder.radius": Key("its radius", "mm"),
    },
    "[[poses]]": {
        "name": Key("letters, digits, `-` and `_`; it names files, and `rest` is taken"),
        "fixed": Key("regions that stay"),
        "handles": Key("[regions that move](#poses-handles)"),
        "gravity": Key(
            "direction and size in multiples of g, as `[0, 0, -1]`", "g", default="none"
        ),
        "drags": Key("[springs that pull at points](#poses-drags)"),
        "pressures": Key("[pressures on regions](#poses-pressures)"),
        "symmetry": Key("[regions that stay in their plane](#poses-symmetry)"),
    },
    "[[poses.handles]]": {
        "region": Key("the region that moves rigidly"),
        "rotate": Key(
            '`{ axis, degrees }`, or `"free"` for no resultant moment',
            kind='table or `"free"`',
            default="no rotation",
        ),
        "rotate.axis": Key("direction, of any length but zero"),
        "rotate.degrees": Key(
            'the angle (270 degrees stay 270), or `"free"` for a hinge about `axis`',
            "degrees",
            kind='number or `"free"`',
            default="needed",
        ),
        "rotate.about": Key(
            "the point about which the region turns",
            "mm",
            default="middle of the bounding box of the region's nodes",
        ),
        "translate": Key(
            'each number may be `"free"`, and `"free"` alone is all three: no resultant force',
            "mm",
            kind=f'{_SIDE} or `"free"`',
        ),
    },
    "[[poses.drags]]": {
        "at": Key("the point that is pulled", "mm"),
        "by": Key("where to, from there; a mixture of poses scales it", "mm"),
        "stiffness": Key("of the spring; a mixture keeps it", "N/mm"),
    },
    "[[poses.pressures]]": {
        "region": Key("the surface in this region"),
        "value": Key("follows the surface as it moves; positive pushes inwards", "MPa"),
    },
    "[[poses.symmetry]]": {
        "region": Key("a flat region whose nodes stay in their plane"),
        "normal": Key("of the plane, of any length but zero"),
    },
    "[states]": {
        "ramp": Key(
            "fractions of every pose that the optimiser sees, above 0 and up to 1",
            kind="list of numbers",
        ),
        "mixtures": Key(
            "poses at once, as `[{ bend_up = 0.5, twist = 0.5 }]`: rotation vectors and"
            " translations add up; a region that one pose leaves free and another translates is"
            " moved on from where the first leaves it; `[]` is none",
            default="where neither these nor `held_out` are given: poses that agree and are not"
            " opposite, in pairs, whole and half; what cannot be solved is left out with a note",
        ),
        "mixtures.POSE": Key("weight of the pose of this name", default="0"),
        "held_out": Key(
            "mixtures to which neither paths nor decoder are fitted: by them the layouts made on"
            " trial are compared, and the error is told",
            default="as with `mixtures`: pairs of a whole and a half, and three at once",
        ),
        "held_out.POSE": Key("weight of the pose of this name", default="0"),
    },
    "[outputs]": {
        "markers": Key(
            'how many points to spread on the surface, the points (mm), or `"surface"` for all of'
            " it",
            kind=f'whole number, list of {_SIDE}, or `"surface"`',
        ),
        "anchor": Key(
            "the region that stays, to which recorded markers are aligned; builds do without",
            default="none",
        ),
    },
    "[cord]": {
        "name": Key(
            "a row of `defsense_fab/data/cords.csv`, or any name with the four keys below",
            default='needed; `"custom"` with them',
        ),
        "diameter": Key("of the cord", "mm", default="the row's; needed without one"),
        "ohm_per_mm": Key(
            "resistance at rest: a tenth of the ohm/cm of sellers",
            "Ω/mm",
            default="the row's; needed without one",
        ),
        "gauge_factor": Key(
            "(R - R0)/R0 divided by the strain: 2 where the resistance doubles at 50 %",
            default="the row's; needed without one",
        ),
        "max_strain": Key(
            "the largest strain that the cord takes, 0.5 for 50 %",
            default="the row's; needed without one",
        ),
        "min_bend_radius": Key(
            "least radius of the channel's middle line",
            "mm",
            default="the row's, or 2.5 diameters",
        ),
        "ferrule_diameter": Key(
            "outside of the ferrule that joins cord and wire",
            "mm",
            default="the row's, or the diameter and 0.6",
        ),
        "ferrule_length": Key("of that ferrule", "mm", default="the row's, or 7"),
        "modulus": Key("Young's modulus of the rubber", "MPa", default="the row's, or 3"),
        "noise": Key("standard deviation of (R - R0)/R0 that does not depend on the cord's length"),
        "contact": Key(
            "standard deviation of the resistance of each joint of cord and wire: short cords feel"
            " it most",
            "Ω",
        ),
        "min_stretch": Key(
            "least length that is stretched between a cord's ends; shorter cords are not proposed,"
            " and drawn ones refused",
            "mm",
            default="the row's, or 10 diameters",
        ),
        "compression": Key(
            "what the data sheet does not say, for bonded cords: below zero strain `same` has the"
            " slope of tension, `half` half of it, `none` no slope, and with `rising` the"
            " resistance rises both ways; not with `response`"
        ),
        "response": Key(
            "a `response.json` of `defsense calibrate fit`, in place of the data sheet's gauge"
            " factor and `compression`; signals then follow it, strains outside of its range are"
            " told, and built devices scatter by the spread of the pieces that were measured",
            default="none",
        ),
        "length": Key(
            "`[least, greatest]` length of the pieces that you have, free ends included; layouts"
            " keep to it, and drawn cords that do not are refused",
            "mm",
            default="any",
        ),
    },
    "[readout]": {
        "converter": Key(
            "`arduino` has 10 bits and 16 conversions a sample, `ads1115` 16 bits and one: its"
            " steps are part of the noise"
        ),
    },
    "[fabrication]": {
        "process": Key("a row of `defsense_fab/data/printers.csv`"),
        "clearance": Key(
            "of a cord in its channel, on the diameter; the fit coupon tells it", "mm"
        ),
        "wall": Key("least wall between a channel and the surface", "mm"),
        "lead": Key("free cord at each end, where there are no pockets", "mm"),
        "line": Key("width of what the nozzle lays", "mm"),
        "layer": Key("height of a layer", "mm"),
        "hole": Key("the least hole that stays open", "mm"),
        "bed": Key("width, depth and height of what your printer makes", "mm"),
        "copies": Key("how many devices lie on the plates (`docs/fabrication.md`)"),
        "assembly": Key(
            "`held`: cords are held at their ends and slide between them; `bonded`: they are glued"
            " into their grooves all along (`docs/fabrication.md`)"
        ),
        "prestretch": Key(
            "share of its length by which a held cord is stretched as it is laid, less than the"
            " strain that it takes",
            default="as much as it needs",
        ),
        "pockets": Key("pockets for the joints of cord and wire (`docs/fabrication.md`)"),
        "limit_cuts": Key("whether planes cut no further than their cords need"),
        "strain_relief": Key(
            "whether wires leave their pockets by a bend",
            default="unless that raises the predicted error by more than 5 %",
        ),
        "wire_diameter": Key("outside of a wire, thinner than the cord's ferrule", "mm"),
        "marker_seats": Key("how many flats for camera tags", default="none"),
        "marker_size": Key("the tags' side", "mm"),
        "mould_wall": Key("walls of the moulds, with a process that casts", "mm"),
        "shrinkage": Key(
            "linear shrinkage of the silicone, a share of the length, with a process that casts",
            default="its row of `data/silicones.csv`",
        ),
    },
    "[design]": {
        "sensors": Key(
            "how many cords there are to be: those that are not drawn are found",
            default="those drawn",
        ),
        "planes": Key(
            "the most planes that found cords may take: fewer planes, fewer parts", default="any"
        ),
        "decoder": Key(
            "`affine` maps the signals; `quadratic` their squares and products too, `kernel` any"
            " smooth function of them: better with many states and little noise; `auto` designs for"
            " each and takes the one that does best on unseen states, or `affine` where there are"
            " none"
        ),
        "prefer": Key(
            "`simple`: of the layouts within 5 % of the best as built the one with nothing to"
            " say of it, the fewest parts, and planes parallel to flat faces; `accuracy`: the"
            " best that can be made"
        ),
        "seed": Key("another number draws other random choices for the search for cords"),
        "searches": Key(
            "the most searches that a layout is chosen from: fewer are quicker, and find less",
            default="15 divided by the cords, at least 5, and some in fewer planes",
        ),
    },
    "[[sensors]]": {
        "name": Key("the cord's name, which no other has"),
        "plane": Key("`{ origin, normal, x_axis }`, the plane that it lies in and that is cut"),
        "plane.origin": Key("where the plane's coordinates are zero", "mm"),
        "plane.normal": Key("direction, of any length but zero"),
        "plane.x_axis": Key("direction of the first coordinate, across the normal"),
        "control_points": Key(
            "in the plane; at least four, the first and last two are the ends and stay",
            "mm",
            kind="list of `[x, y]`",
        ),
        "tangents": Key(
            "in the plane, one a control point",
            "mm",
            kind="list of `[x, y]`",
            default="Catmull-Rom",
        ),
        "free": Key(
            "what the optimiser may change: `path`, with it `plane`, or `offset` for a plane that"
            " shifts and keeps its direction; `[]` keeps the cord as drawn"
        ),
    },
}
