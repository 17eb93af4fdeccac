"""3MF: what a file holds besides the body, as its objects and slicers' files name it.

`DEFSENSE_VARIANTS=1000` reads that many prints in place of the few of the suite.
"""

from __future__ import annotations

import os
import zipfile

import numpy as np
import pytest

from defsense_fab.core.errors import BodyError
from defsense_fab.geometry.bodies.mesh_files import detect_format, read_mesh, read_triangles
from tests.support.errors import raises
from tests.support.gltf_files import CUBE, CUBE_FACES

VARIANTS = int(os.environ.get("DEFSENSE_VARIANTS", "60"))
SIZES = (1.0, 1e4)
BAR = ((0, 0, 0), (120, 30, 20))
BAR_VOLUME = 72_000
OTHER_TYPES = ("support", "solidsupport", "surface", "other")
MS = "http://schemas.microsoft.com/3dmanufacturing"
NAMESPACES = (
    f'xmlns="{MS}/core/2015/02" xmlns:p="{MS}/production/2015/06" xmlns:m="{MS}/material/2015/02"'
    f' xmlns:b="{MS}/beamlattice/2017/02" xmlns:o="{MS}/booleanoperations/2023/07"'
)
RELATIONS = (
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    f'<Relationship Target="/3D/3dmodel.model" Id="r" Type="{MS[:-16]}3dmanufacturing/2013/01/'
    '3dmodel"/></Relationships>'
)


def mesh(*boxes, more=""):
    """Return the mesh of boxes, each given as two corners."""
    points = np.concatenate([low + CUBE * np.subtract(high, low) for low, high in boxes])
    faces = np.concatenate([CUBE_FACES + 8 * k for k in range(len(boxes))])
    vertices = "".join('<vertex x="{:.9g}" y="{:.9g}" z="{:.9g}"/>'.format(*p) for p in points)
    triangles = "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*f) for f in faces)
    return f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles>{more}</mesh>"


def solid(number, *boxes, kind="model", more="", keys=""):
    return f'<object id="{number}" type="{kind}" {keys}>{more}{mesh(*boxes)}</object>'


def group(number, *components, kind="model"):
    inner = "".join(f"<component {keys}/>" for keys in components)
    return f'<object id="{number}" type="{kind}"><components>{inner}</components></object>'


def model(objects, items, keys='unit="millimeter"'):
    build = "".join(f"<item {item}/>" for item in items)
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<model {keys} {NAMESPACES}><resources>'
        f"{objects}</resources><build>{build}</build></model>"
    )


def write(folder, text, **files):
    """Write a 3MF file with a main model, and other files whose names have `__` for slashes."""
    path = folder / "a.3mf"
    contents = {"_rels/.rels": RELATIONS, "3D/3dmodel.model": text}
    contents |= {name.replace("__", "/") + ".config": value for name, value in files.items()}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            archive.writestr(name.replace(".model.config", ".model"), content)
    return path


def prusa(number, *kinds):
    """Return PrusaSlicer's file on the volumes of an object, each a box."""
    volumes = "".join(
        f'<volume firstid="{12 * k}" lastid="{12 * k + 11}"><metadata type="volume"'
        f' key="volume_type" value="{kind}"/></volume>'
        for k, kind in enumerate(kinds)
    )
    return f'<?xml version="1.0"?><config><object id="{number}">{volumes}</object></config>'


def bambu(number, **kinds):
    parts = "".join(f'<part id="{name[1:]}" subtype="{kind}"/>' for name, kind in kinds.items())
    return f'<config><object id="{number}">{parts}</object></config>'


def check_bar(path, notes):
    """Check that the file is read as the bar, with that many notes."""
    assert detect_format(path.read_bytes()) == ".3mf"
    surface, told, _ = read_mesh(path, 1.0, SIZES)
    assert surface.volume == pytest.approx(BAR_VOLUME)
    assert surface.bounds == pytest.approx(np.array(BAR), abs=1e-4)
    assert len(told) == notes


@pytest.mark.parametrize("kind", OTHER_TYPES)
@pytest.mark.parametrize("place", ["item", "component"])
def test_objects_of_other_types_are_left_out(kind, place, tmp_path):
    objects = solid(1, BAR) + solid(2, ((50, 5, -40), (70, 25, 0)), kind=kind)
    items = ['objectid="1"', 'objectid="2"']
    if place == "component":
        objects += group(3, *items)
        items = ['objectid="3"']
    check_bar(write(tmp_path, model(objects, items)), 1)


@pytest.mark.parametrize("kind", OTHER_TYPES)
def test_a_file_without_a_body_names_what_it_holds(kind, tmp_path):
    path = write(tmp_path, model(solid(1, BAR, kind=kind), ['objectid="1"']))
    with raises(BodyError, "no-body-object"):
        read_triangles(path, ".3mf")


def test_items_that_are_not_printed_are_left_out(tmp_path):
    objects = solid(1, BAR) + solid(2, ((200, 0, 0), (210, 9, 9)))
    items = ['objectid="1" printable="1"', 'objectid="2" printable="0"']
    check_bar(write(tmp_path, model(objects, items)), 1)
    path = write(tmp_path, model(objects, [item.replace('"1"/', '"0"') for item in items[1:]]))
    with raises(BodyError, "no-body-object"):
        read_triangles(path, ".3mf")


@pytest.mark.parametrize("name", ["Slic3r_PE_model", "SuperSlicer_model", "Prusa_Slicer_model"])
def test_volumes_of_prusaslicer(name, tmp_path):
    hole, modifier = ((50, -1, -1), (70, 31, 10)), ((-5, -5, 5), (40, 35, 15))
    text = model(solid(1, BAR, hole, modifier), ['objectid="1"'])
    kinds = prusa(1, "ModelPart", "NegativeVolume", "ParameterModifier")
    path = write(tmp_path, text, **{f"Metadata__{name}": kinds})
    surface, notes, _ = read_mesh(path, 1.0, SIZES)
    assert surface.volume == pytest.approx(BAR_VOLUME - 20 * 30 * 10)
    assert surface.bounds == pytest.approx(np.array(BAR), abs=1e-4)
    assert len(notes) == 2
    for kind in ("SupportBlocker", "SupportEnforcer", "ParameterModifier"):
        text = model(solid(1, BAR, modifier), ['objectid="1"'])
        check_bar(write(tmp_path, text, **{f"Metadata__{name}": prusa(1, "ModelPart", kind)}), 1)


def test_modifiers_of_old_slicers(tmp_path):
    text = model(solid(1, BAR, ((-5, -5, 5), (40, 35, 15))), ['objectid="1"'])
    kinds = prusa(1, "ModelPart", "x").replace('"volume_type" value="x"', '"modifier" value="1"')
    check_bar(write(tmp_path, text, Metadata__Slic3r_PE_model=kinds), 1)


@pytest.mark.parametrize("path", ["", ' p:path="/3D/Objects/part_1.model"'])
def test_parts_of_bambu_studio(path, tmp_path):
    """The parts of newer files are in a model of their own."""
    boxes = [
        BAR,
        ((50, -1, -1), (70, 31, 10)),
        ((-5, -5, 5), (40, 35, 15)),
        ((0, 0, 9), (9, 9, 99)),
    ]
    kinds = ("model", "other", "other", "other")
    parts = "".join(
        solid(k, b, kind=t) for k, (b, t) in enumerate(zip(boxes, kinds, strict=True), 1)
    )
    uses = [f'objectid="{k}"{path}' for k in range(1, 5)]
    objects = group(8, *uses) if path else parts + group(8, *uses)
    settings = bambu(8, p1="normal_part", p2="negative_part", p3="modifier_part",
                     p4="support_enforcer")  # fmt: skip
    keys = 'unit="millimeter" requiredextensions="p"'
    files = {"Metadata__model_settings": settings, "Metadata__project_settings": '{"a": "1"}'}
    if path:
        files["3D__Objects__part_1.model"] = model(parts, [], keys)
    place = write(tmp_path, model(objects, ['objectid="8"'], keys), **files)
    surface, notes, _ = read_mesh(place, 1.0, SIZES)
    assert surface.volume == pytest.approx(BAR_VOLUME - 20 * 30 * 10)
    assert surface.bounds == pytest.approx(np.array(BAR), abs=1e-4)
    assert len(notes) == 3


def test_an_open_negative_volume_is_refused(tmp_path):
    text = model(solid(1, BAR, ((50, -1, -1), (70, 31, 10))), ['objectid="1"'])
    text = text.replace('<triangle v1="8" v2="9" v3="11"/>', "")
    kinds = prusa(1, "ModelPart", "NegativeVolume").replace('lastid="23"', 'lastid="22"')
    path = write(tmp_path, text, Metadata__Slic3r_PE_model=kinds)
    with raises(BodyError, "negative-volume"):
        read_triangles(path, ".3mf")
    path = write(tmp_path, text, Metadata__Slic3r_PE_model=kinds.replace("Negative", "Magic"))
    with raises(BodyError, "volume-kind-unknown"):
        read_triangles(path, ".3mf")


def test_meshes_that_cura_prints_otherwise_are_left_out(tmp_path):
    for name in ("infill", "cutting", "support", "anti_overhang"):
        setting = '<metadatagroup><metadata name="cura:{}_mesh">{}</metadata></metadatagroup>'
        objects = solid(1, BAR, more=setting.format(name, "False"))
        objects += solid(2, ((0, 0, -9), (9, 9, 0)), more=setting.format(name, "True"))
        check_bar(write(tmp_path, model(objects, ['objectid="1"', 'objectid="2"'])), 1)


@pytest.mark.parametrize("with_mesh", [True, False])
def test_a_beam_lattice_is_named(with_mesh, tmp_path):
    beams = '<b:beamlattice radius="1"><b:beams><b:beam v1="0" v2="1"/></b:beams></b:beamlattice>'
    text = model(f'<object id="1">{mesh(BAR, more=beams)}</object>', ['objectid="1"'])
    if not with_mesh:
        start, end = text.index("<triangles>"), text.index("</triangles>")
        text = text[:start] + text[end + 12 :]
    with raises(BodyError, "beam-lattice"):
        read_triangles(write(tmp_path, text), ".3mf")


def test_shapes_and_required_extensions_that_are_not_read_are_named(tmp_path):
    text = model('<object id="1"><o:booleanshape objectid="2"/></object>', ['objectid="1"'])
    with raises(BodyError, "shape-unsupported", shape="booleanshape"):
        read_triangles(write(tmp_path, text), ".3mf")
    text = model(solid(1, BAR), ['objectid="1"'], 'requiredextensions="o"')
    with raises(BodyError, "extension-unsupported"):
        read_triangles(write(tmp_path, text), ".3mf")
    check_bar(write(tmp_path, text.replace('extensions="o"', 'extensions="p m"')), 0)


@pytest.mark.parametrize(
    ("materials", "keys"),
    [
        ('<basematerials id="5"><base name="x" displaycolor="#12"/></basematerials>', 'pid="5"'),
        ("", 'pid="9" pindex="3"'),
        ('<m:colorgroup id="5"><m:color color="red"/></m:colorgroup>', 'pid="5" pindex="7"'),
        ('<m:multiproperties id="5" pids="5 6"/>', 'pid="5"'),
    ],
)
def test_wrong_colors_do_not_stop_the_reading(materials, keys, tmp_path):
    text = model(materials + solid(1, BAR, keys=keys), ['objectid="1"'])
    text = text.replace('<triangle v1="0"', '<triangle pid="77" p1="9" v1="0"')
    check_bar(write(tmp_path, text), 0)


def test_an_xml_document_type_is_refused(tmp_path):
    """It could define entities that expand without end."""
    text = model(solid(1, BAR), ['objectid="1"'])
    entity = '<!DOCTYPE model [<!ENTITY a "1">]><model '
    with raises(BodyError, "file-invalid"):
        read_triangles(write(tmp_path, text.replace("<model ", entity, 1)), ".3mf")


def test_objects_that_contain_themselves_are_refused(tmp_path):
    objects = group(1, 'objectid="2"') + group(2, 'objectid="1"', 'objectid="1"')
    with raises(BodyError, "file-invalid"):
        read_triangles(write(tmp_path, model(objects, ['objectid="1"'])), ".3mf")
    objects = solid(1, BAR) + "".join(group(k, *[f'objectid="{k - 1}"'] * 2) for k in range(2, 60))
    with raises(BodyError, "file-too-large"):
        read_triangles(write(tmp_path, model(objects, ['objectid="59"'])), ".3mf")


def test_text_in_utf_16_is_read(tmp_path):
    text = model(solid(1, BAR), ['objectid="1"']).replace("UTF-8", "UTF-16")
    check_bar(write(tmp_path, text.encode("utf-16")), 0)


def _print(rng):
    """Return a print of boxes side by side, other things, and its volume and number of notes."""
    objects, items, files, volume, left_out = [], [], {}, 0.0, set()
    for k in range(1, int(rng.integers(2, 6))):
        size = rng.integers(5, 40, 3)
        box = ((100 * k, 0, 0), tuple(size + np.array([100 * k, 0, 0])))
        role = int(rng.integers(7))
        use, matrix = f'objectid="{k}"', np.vstack([np.diag(rng.choice([-1, 1, 2], 3)), [0, 5, 7]])
        place = ' transform="{}"'.format(" ".join(f"{x:g}" for x in matrix.ravel()))
        scale = abs(np.linalg.det(matrix[:3]))
        if role == 0:
            kind = OTHER_TYPES[int(rng.integers(4))]
            objects.append(solid(k, box, kind=kind))
            left_out.add(kind)
        elif role == 1:
            objects.append(solid(k, box))
            use += ' printable="0"'
            left_out.add("item")
        elif role == 2:
            objects.append(solid(k, box, (box[0], np.add(box[0], 3))))
            kind = ["ParameterModifier", "SupportBlocker", "SupportEnforcer"][int(rng.integers(3))]
            files["Metadata__Slic3r_PE_model"] = files.get("Metadata__Slic3r_PE_model", "")
            files["Metadata__Slic3r_PE_model"] += prusa(k, "ModelPart", kind)[29:-9]
            volume += scale * size.prod()
            left_out.add(kind)
        elif role == 3:
            objects.append(solid(k, box, (np.subtract(box[0], 1), np.add(box[0], 3))))
            files["Metadata__Slic3r_PE_model"] = files.get("Metadata__Slic3r_PE_model", "")
            files["Metadata__Slic3r_PE_model"] += prusa(k, "ModelPart", "NegativeVolume")[29:-9]
            volume += scale * (size.prod() - 27)
            left_out.add("negative")
        elif role == 4:
            objects += [solid(10 * k, box), solid(10 * k + 1, box, kind="other")]
            objects.append(group(k, f'objectid="{10 * k}"', f'objectid="{10 * k + 1}"'))
            volume += scale * size.prod()
            left_out.add("other")
        else:
            objects.append(solid(k, box, keys=f'pid="{rng.integers(99)}"'))
            volume += scale * size.prod()
        items.append(use + place)
    if files:
        inner = files["Metadata__Slic3r_PE_model"]
        files["Metadata__Slic3r_PE_model"] = f"<config>{inner}</config>"
    return model("".join(objects), items), files, volume, left_out


def _damage(text, rng):
    """Return a damaged model."""
    which = int(rng.integers(6))
    if which == 0:
        return text[: int(rng.integers(1, len(text) - 1))]
    old, new = [
        ('<triangle v1="', '<triangle v1="9999999'),
        ('<vertex x="', '<vertex x="1,'),
        ('unit="millimeter"', 'unit="furlong"'),
        ("<item objectid=", '<item objectid="77" '.replace(" ", "\n") + "name="),
        ('v2="', 'v5="'),
    ][which - 1]
    return text.replace(' printable="0"', "").replace(old, new, 1)


def test_random_prints_are_read_right_and_damaged_ones_are_refused(tmp_path):
    rng = np.random.default_rng(53)
    for k in range(VARIANTS):
        text, files, volume, left_out = _print(rng)
        path = write(tmp_path, text, **files)
        if not volume:
            with raises(BodyError, "no-body-object"):
                read_triangles(path, ".3mf")
            continue
        result = read_triangles(path, ".3mf")
        assert np.linalg.det(result.vertices[result.faces]).sum() / 6 == pytest.approx(
            volume, rel=1e-4
        ), k
        assert len(result.notes) == len(left_out), k
        damaged = write(tmp_path, _damage(text, rng))
        with pytest.raises(BodyError) as caught:
            read_triangles(damaged, ".3mf")
        assert caught.value.code in ("file-invalid", "vertex-missing"), k
