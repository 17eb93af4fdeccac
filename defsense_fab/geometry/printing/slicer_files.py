"""Write one object of several solids, each with its extruder, as 3MF files for slicers.

Slicers share no standard for the extruder of a solid. PrusaSlicer reads ranges of triangles of one
mesh; Bambu Studio and OrcaSlicer read parts of an assembly; other programs read base materials.
The same solids give the same bytes.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

from ...core.errors import FabricationError
from ...core.mesh import Surface
from .export import fill_mesh, make_uuid, prepare_3mf_mesh

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
_PACKAGE = "http://schemas.openxmlformats.org/package/2006"
_XML = '<?xml version="1.0" encoding="UTF-8"?>\n'
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)  # the earliest time of the format

#: Bambu Studio and OrcaSlicer read the parts' extruders only if this application wrote the file.
BAMBU_APPLICATION = "BambuStudio-01.09.05.51"
#: More loops than a trace has room for: the slicer fills the whole trace with loops.
SOLID_WALL_LOOPS = 20
#: Display colors of base materials by extruder, RGB.
_COLORS = ((235, 235, 225), (40, 40, 40), (200, 60, 60), (60, 90, 200))


@dataclass(frozen=True)
class ColoredSolid:
    """Closed surface that one extruder prints.

    Attributes:
        name: Name in the slicer.
        surface: Closed surface, mm, in the frame of the print: the bed is z = 0.
        extruder: Number of the extruder in the slicer, from 1.
        is_trace: Whether to print the solid without voids, because it conducts.
    """

    name: str
    surface: Surface
    extruder: int
    is_trace: bool = False


def write_prusa_3mf(
    solids: Sequence[ColoredSolid], path: Path, title: str, settings: str = ""
) -> None:
    """Write solids as one object for PrusaSlicer and SuperSlicer.

    Args:
        solids: Solids of the object. Where two overlap, the slicer keeps the later.
        path: The file.
        title: Name of the object.
        settings: Text of an ini file of `slicer_settings`, which the slicer applies as it opens
            the file: a printer with one extruder would drop the solids' extruders.

    Raises:
        FabricationError: There is no solid, an extruder or name is invalid, or corners that are
            apart in a surface cannot be kept apart.
    """
    _check(solids, path)
    vertices, triangles, volumes, corner, first = [], [], [], 0, 0
    for solid in solids:
        mesh = prepare_3mf_mesh(solid.surface, solid.name)
        vertices.append(_format_vertices(mesh))
        triangles.append(_format_triangles(mesh, corner))
        last = first + len(mesh.faces) - 1
        keys = [("name", solid.name), ("volume_type", "ModelPart")]
        keys += [("extruder", str(solid.extruder))]
        if solid.is_trace:
            keys += [("perimeters", str(SOLID_WALL_LOOPS)), ("fill_density", "100%")]
        rows = "".join(_format_prusa_setting("volume", key, value) for key, value in keys)
        volumes.append(f'  <volume firstid="{first}" lastid="{last}">\n{rows}  </volume>\n')
        corner, first = corner + len(mesh.vertices), last + 1
    head = _format_prusa_setting("object", "name", title)
    config = (
        f'{_XML}<config>\n <object id="1" instances_count="1">\n{head}'
        f"{''.join(volumes)} </object>\n</config>\n"
    )
    model = (
        f'{_XML}<model unit="millimeter" xml:lang="en-US" xmlns="{_CORE}"'
        ' xmlns:slic3rpe="http://schemas.slic3r.org/3mf/2017/06">\n'
        ' <metadata name="slic3rpe:Version3mf">1</metadata>\n'
        f' <resources>\n  <object id="1" type="model" name={quoteattr(title)}>\n   <mesh>\n'
        f"    <vertices>\n{''.join(vertices)}    </vertices>\n"
        f"    <triangles>\n{''.join(triangles)}    </triangles>\n"
        "   </mesh>\n  </object>\n </resources>\n"
        ' <build>\n  <item objectid="1"/>\n </build>\n</model>\n'
    )
    files = {"Metadata/Slic3r_PE_model.config": config}
    if settings:
        lines = "".join(f"; {line}\n" for line in settings.splitlines())
        files["Metadata/Slic3r_PE.config"] = lines
    _write_package(path, model, files)


def write_bambu_3mf(solids: Sequence[ColoredSolid], path: Path, title: str) -> None:
    """Write solids as one object for Bambu Studio and OrcaSlicer.

    The file holds no settings of the printer: those programs reject incomplete ones, and use the
    selected printer without them.

    Args:
        solids: Solids of the object.
        path: The file.
        title: Name of the object.

    Raises:
        FabricationError: There is no solid, an extruder or name is invalid, or corners that are
            apart in a surface cannot be kept apart.
    """
    _check(solids, path)
    objects, components, parts = [], [], []
    for number, solid in enumerate(solids, 1):
        mesh = prepare_3mf_mesh(solid.surface, solid.name)
        objects.append(
            f'  <object id="{number}" name={quoteattr(solid.name)} type="model"'
            f' p:UUID="{make_uuid(title, "object", solid.name)}">\n   <mesh>\n'
            f"    <vertices>\n{_format_vertices(mesh)}    </vertices>\n"
            f"    <triangles>\n{_format_triangles(mesh, 0)}    </triangles>\n"
            "   </mesh>\n  </object>\n"
        )
        uuid = make_uuid(title, "component", solid.name)
        components.append(f'    <component objectid="{number}" p:UUID="{uuid}"/>\n')
        settings = [("name", solid.name), ("extruder", str(solid.extruder))]
        if solid.is_trace:
            settings += [("wall_loops", str(SOLID_WALL_LOOPS)), ("sparse_infill_density", "100%")]
        rows = "".join(_format_bambu_setting(key, value) for key, value in settings)
        parts.append(f'  <part id="{number}" subtype="normal_part">\n{rows}  </part>\n')
    whole = len(solids) + 1
    model = (
        f'{_XML}<model unit="millimeter" xml:lang="en-US" xmlns="{_CORE}"'
        f' xmlns:p="{_PRODUCTION}" xmlns:BambuStudio="http://schemas.bambulab.com/package/2021"'
        ' requiredextensions="p">\n'
        f' <metadata name="Application">{BAMBU_APPLICATION}</metadata>\n'
        ' <metadata name="BambuStudio:3mfVersion">1</metadata>\n'
        f" <resources>\n{''.join(objects)}"
        f'  <object id="{whole}" name={quoteattr(title)} type="model"'
        f' p:UUID="{make_uuid(title, "assembly")}">\n   <components>\n'
        f"{''.join(components)}   </components>\n  </object>\n </resources>\n"
        f' <build p:UUID="{make_uuid(title, "build")}">\n'
        f'  <item objectid="{whole}" p:UUID="{make_uuid(title, "item")}"/>\n'
        " </build>\n</model>\n"
    )
    head = _format_bambu_setting("name", title)
    head += _format_bambu_setting("extruder", str(solids[0].extruder))
    config = (
        f'{_XML}<config>\n <object id="{whole}">\n{head}{"".join(parts)} </object>\n'
        ' <plate>\n    <metadata key="plater_id" value="1"/>\n    <model_instance>\n'
        f'      <metadata key="object_id" value="{whole}"/>\n'
        '      <metadata key="instance_id" value="0"/>\n    </model_instance>\n </plate>\n'
        "</config>\n"
    )
    _write_package(path, model, {"Metadata/model_settings.config": config})


def write_material_3mf(solids: Sequence[ColoredSolid], path: Path, title: str) -> None:
    """Write solids as an assembly with one base material per extruder (3MF core specification).

    Args:
        solids: Solids of the object.
        path: The file.
        title: Name of the assembly.

    Raises:
        FabricationError: There is no solid, an extruder or name is invalid, or corners that are
            apart in a surface cannot be kept apart.
    """
    import lib3mf

    _check(solids, path)
    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.SetUnit(lib3mf.ModelUnit.MilliMeter)
    model.SetBuildUUID(make_uuid(title, "build"))
    group = model.AddBaseMaterialGroup()
    materials = {}
    for extruder in sorted({s.extruder for s in solids}):
        color = wrapper.RGBAToColor(*_COLORS[(extruder - 1) % len(_COLORS)], 255)
        materials[extruder] = group.AddMaterial(f"extruder {extruder}", color)
    assembly = model.AddComponentsObject()
    assembly.SetName(title)
    assembly.SetUUID(make_uuid(title, "assembly"))
    for solid in solids:
        mesh = model.AddMeshObject()
        mesh.SetName(solid.name)
        mesh.SetUUID(make_uuid(title, "object", solid.name))
        fill_mesh(mesh, solid.surface, solid.name)
        mesh.SetObjectLevelProperty(group.GetResourceID(), materials[solid.extruder])
        component = assembly.AddComponent(mesh, wrapper.GetIdentityTransform())
        component.SetUUID(make_uuid(title, "component", solid.name))
    item = model.AddBuildItem(assembly, wrapper.GetIdentityTransform())
    item.SetUUID(make_uuid(title, "item"))
    # Write to memory first: on a full disk lib3mf ends the program.
    path.write_bytes(bytes(model.QueryWriter("3mf").WriteToBuffer()))


#: Writers by family of slicers.
WRITERS: dict[str, Callable[[Sequence[ColoredSolid], Path, str], None]] = {
    "prusa": write_prusa_3mf,
    "bambu": write_bambu_3mf,
    "standard": write_material_3mf,
}


def _check(solids: Sequence[ColoredSolid], path: Path) -> None:
    if not solids:
        raise FabricationError("has no solid", code="no-solids", where=path)
    names = [s.name for s in solids]
    for solid in solids:
        if solid.extruder < 1:
            raise FabricationError(
                f"extruder {solid.extruder} is not a number from 1",
                code="extruder-invalid",
                where=solid.name,
            )
        if names.count(solid.name) > 1:
            raise FabricationError(
                "two solids have this name", code="solid-name-repeated", where=solid.name
            )


def _format_vertices(mesh: Surface) -> str:
    return "".join(
        f'     <vertex x="{x:.6f}" y="{y:.6f}" z="{z:.6f}"/>\n'
        for x, y, z in (mesh.vertices + 0.0).tolist()
    )


def _format_triangles(mesh: Surface, offset: int) -> str:
    return "".join(
        f'     <triangle v1="{a}" v2="{b}" v3="{c}"/>\n'
        for a, b, c in (mesh.faces + offset).tolist()
    )


def _format_prusa_setting(kind: str, key: str, value: str) -> str:
    return f'   <metadata type="{kind}" key="{key}" value={quoteattr(value)}/>\n'


def _format_bambu_setting(key: str, value: str) -> str:
    return f"   <metadata key={quoteattr(key)} value={quoteattr(value)}/>\n"


def _write_package(path: Path, model: str, files: dict[str, str]) -> None:
    """Write a 3MF package with fixed times."""
    types = (
        f'{_XML}<Types xmlns="{_PACKAGE}/content-types">\n'
        f' <Default Extension="rels" ContentType="application/vnd.openxmlformats-package.'
        'relationships+xml"/>\n'
        ' <Default Extension="model" ContentType="application/vnd.ms-package.'
        '3dmanufacturing-3dmodel+xml"/>\n'
        ' <Default Extension="config" ContentType="text/xml"/>\n</Types>\n'
    )
    relations = (
        f'{_XML}<Relationships xmlns="{_PACKAGE}/relationships">\n'
        ' <Relationship Target="/3D/3dmodel.model" Id="rel-1"'
        ' Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>\n'
        "</Relationships>\n"
    )
    entries = {"[Content_Types].xml": types, "_rels/.rels": relations, "3D/3dmodel.model": model}
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in (entries | files).items():
            info = zipfile.ZipInfo(name, _ZIP_TIME)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.create_system = 3  # the same bytes on every system
            archive.writestr(info, text)
