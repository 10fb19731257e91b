"""Bad input: each fault is one line that says what, where and what to do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from experiments.errors import InputError
from experiments.scenes import load_scene
from experiments.scenes.checks import check_scene
from experiments.scenes.parts import SceneDict, diffuse, empty_scene, perspective, solid_box

pytestmark = pytest.mark.usefixtures("variant")

CAMERA = """<sensor type="perspective"><transform name="to_world">
<lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform></sensor>"""
LIGHT = '<emitter type="constant"/>'
BALL = '<shape type="sphere" id="ball"/>'


def xml(*parts: str) -> str:
    return f'<scene version="3.0.0">{"".join(parts)}</scene>'


def refused(source: str | Path, match: str, **arguments: Any) -> InputError:
    """Load, and demand one line that names the source."""
    with pytest.raises(InputError, match=match) as caught:
        load_scene(str(source), **arguments)
    line = str(caught.value)
    assert "\n" not in line
    assert Path(source).name in line
    return caught.value


def file_with(folder: Path, name: str, content: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


# Not a scene ---------------------------------------------------------------------------------


def test_missing_file(tmp_path: Path) -> None:
    refused(tmp_path / "nothing.xml", "no such file.*correct the path")


def test_unknown_name() -> None:
    refused("cornel_box", "no built-in scene and no file.*cornell_box, sealed_rooms")


def test_folder(tmp_path: Path) -> None:
    refused(tmp_path, "a folder, not a scene")


def test_wrong_ending(tmp_path: Path) -> None:
    refused(file_with(tmp_path, "scene.blend", "x"), r"\.blend.* is not a scene.*\.xml, \.py")


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("<scene version='3.0.0'><shape type='sphere'></scene>", "Start-end tags mismatch"),
        ("hello", "XML cannot be parsed.*mend the XML"),
        ("", "XML cannot be parsed"),
        ("<html><body/></html>", "not a Mitsuba scene: the root element <html>"),
        ("<bsdf version='3.0.0' type='diffuse'/>", "not a Mitsuba scene.*into a <scene>"),
        (xml('<shape type="spehre"/>'), 'no shape plugin "spehre"'),
        (xml('<float name="x" value="$size"/>'), r"needs the parameter \$size"),
        (
            xml('<shape type="sphere"><float name="radiuss" value="1"/></shape>'),
            "cannot load the scene .*radiuss",
        ),
    ],
)
def test_xml_that_is_no_scene(tmp_path: Path, text: str, match: str) -> None:
    error = refused(file_with(tmp_path, "bad.xml", text), match)
    if "into a <scene>" not in match:
        assert error.__cause__ is not None, "--debug shows Mitsuba's own error"


def test_xml_line_is_named(tmp_path: Path) -> None:
    refused(file_with(tmp_path, "a.xml", xml("\n\n", '<shape type="x"/>')), r"a\.xml, line 3")


def test_xml_parameter_without_use(tmp_path: Path) -> None:
    path = file_with(tmp_path, "a.xml", xml(CAMERA, LIGHT, BALL))
    refused(path, r"no use for the parameters .*zork", parameters={"zork": "1"})


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("x = 1", r"no function scene\(\)"),
        ("scene = {}", r"no function scene\(\)"),
        ("def scene(:", "cannot be run .SyntaxError"),
        ("import nothing_of_this_name", "cannot be run .ModuleNotFoundError"),
        ("def scene():\n    raise KeyError('wall')", r"scene\(\) failed .KeyError: 'wall'"),
        ("def scene():\n    return 3", r"scene\(\) returned int, not a dict"),
        ("def scene():\n    return {'type': 'sphere'}", "not a Mitsuba scene"),
        ("def scene():\n    return {'type': 'scene', 'a': {'type': 'foo'}}", 'no .* plugin "foo"'),
        ("def scene():\n    return {'type': 'scene', 'a': object()}", "cannot load the scene"),
    ],
)
def test_python_that_makes_no_scene(tmp_path: Path, text: str, match: str) -> None:
    refused(file_with(tmp_path, "bad.py", text), match)


@pytest.mark.parametrize(
    ("parameters", "match"),
    [
        ({"thickness": "1"}, "no parameter thickness.*wall_thickness, turn"),
        ({"wall_thickness": "thick"}, '"thick" is not a value of the parameter wall_thickness'),
        ({"wall_thickness": "9"}, "wall_thickness must be in"),
    ],
)
def test_bad_parameters_of_a_built_in_scene(parameters: dict[str, str], match: str) -> None:
    refused("sealed_rooms", match, parameters=parameters)


def test_offset_with_two_numbers() -> None:
    refused("small_light", '"1, 2" is not a value', parameters={"light_offset": "1, 2"})


# glTF ----------------------------------------------------------------------------------------

ASSET = {"asset": {"version": "2.0"}}


@pytest.mark.parametrize(
    ("content", "match"),
    [
        ("{", "glTF file is broken .JSONDecodeError"),
        ("{}", "glTF file is broken .KeyError"),
        (json.dumps({"asset": {"version": "1.0"}}), "this is glTF 1.0.*2.0"),
        (json.dumps(ASSET), "no geometry"),
        (json.dumps(ASSET | {"buffers": [{"byteLength": 4, "uri": "a.bin"}]}), 'file "a.bin" is'),
        (json.dumps(ASSET | {"buffers": [{"byteLength": 4}]}), "buffer has no content"),
        (json.dumps(ASSET | {"buffers": [{"byteLength": 9, "uri": "data:,"}]}), "is cut short"),
        (
            json.dumps(ASSET | {"extensionsRequired": ["KHR_draco_mesh_compression"]}),
            "needs KHR_draco_mesh_compression.*without",
        ),
        (json.dumps(ASSET | {"scenes": [{"nodes": [3]}]}), "glTF file is broken .KeyError"),
    ],
)
def test_broken_gltf(tmp_path: Path, content: str, match: str) -> None:
    refused(file_with(tmp_path, "bad.gltf", content), match)


def test_glb_cut_short(tmp_path: Path) -> None:
    refused(file_with(tmp_path, "bad.glb", b"glTF\2\0\0\0\0\0\0\0\7\0"), "glTF file is broken")


def test_gltf_nodes_in_a_circle(tmp_path: Path) -> None:
    tree = ASSET | {"scenes": [{"nodes": [0]}], "nodes": [{"children": [0]}]}
    refused(file_with(tmp_path, "bad.gltf", json.dumps(tree)), "broken .RecursionError")


# Something is missing ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parts", "match"),
    [
        ((LIGHT, BALL), "no camera.*add a sensor"),
        ((CAMERA, BALL), "no light.*add an emitter"),
        ((CAMERA, LIGHT), "no geometry.*add a shape"),
    ],
)
def test_missing_part(tmp_path: Path, parts: tuple[str, ...], match: str) -> None:
    refused(file_with(tmp_path, "a.xml", xml(*parts)), match)


@pytest.mark.parametrize("index", [1, -1])
def test_camera_that_is_not_there(tmp_path: Path, index: int) -> None:
    path = file_with(tmp_path, "a.xml", xml(CAMERA, LIGHT, BALL))
    refused(path, f"no camera {index}, the scene has 1.*from 0 to 0", sensor_index=index)


@pytest.mark.parametrize("name", ["e.obj", "e.ply"])
def test_mesh_without_triangles(tmp_path: Path, name: str) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\n"
    header += "property float z\nelement face 0\nproperty list uchar int vertex_indices\n"
    content = "# empty\n" if name == "e.obj" else header + "end_header\n"
    refused(file_with(tmp_path, name, content), "no geometry")


def test_missing_texture(tmp_path: Path) -> None:
    ball = """<shape type="sphere"><bsdf type="diffuse"><texture type="bitmap" name="reflectance">
    <string name="filename" value="wood.png"/></texture></bsdf></shape>"""
    path = file_with(tmp_path, "a.xml", xml(CAMERA, LIGHT, ball))
    refused(path, 'texture file "wood.png" is missing.*a.xml.*put the file there')


def test_missing_environment_map(tmp_path: Path) -> None:
    sky = '<emitter type="envmap"><string name="filename" value="sky.exr"/></emitter>'
    refused(file_with(tmp_path, "a.xml", xml(CAMERA, sky, BALL)), 'file "sky.exr" is missing')


def test_missing_mesh_file(tmp_path: Path) -> None:
    mesh = '<shape type="ply"><string name="filename" value="chair.ply"/></shape>'
    path = file_with(tmp_path, "a.xml", xml(CAMERA, LIGHT, mesh))
    refused(path, 'mesh file "chair.ply" is missing')


# Geometry ------------------------------------------------------------------------------------


def binary_ply(positions: list[list[float]], faces: list[list[int]]) -> bytes:
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(positions)}\n"
    header += "property float x\nproperty float y\nproperty float z\n"
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    body = np.array(positions, "<f4").tobytes()
    for face in faces:
        body += b"\3" + np.array(face, "<i4").tobytes()
    return header.encode() + body


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_mesh_file_with_vertices_that_are_not_finite(tmp_path: Path, value: float) -> None:
    content = binary_ply([[0, 0, 0], [1, 0, 0], [value, 1, 0]], [[0, 1, 2]])
    refused(file_with(tmp_path, "bad.ply", content), '"bad.ply" has vertices that are NaN')


def python_mesh(positions: list[list[float]], faces: list[list[int]]) -> Any:
    mesh = mi.Mesh("sail", len(positions), len(faces))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(np.array(positions, np.float32).ravel())
    parameters["faces"] = mi.UInt32(np.array(faces, np.uint32).ravel())
    parameters.update()
    return mesh


def seen(**objects: Any) -> SceneDict:
    """Objects under a constant sky, seen from +Z."""
    scene = empty_scene()
    scene["sky"] = {"type": "constant"}
    scene["sensor"] = perspective((0, 0, 5), (0, 0, 0), 40)
    return scene | objects


@pytest.mark.parametrize("value", [float("nan"), float("-inf")])
def test_python_mesh_with_vertices_that_are_not_finite(value: float) -> None:
    sail = python_mesh([[0, 0, 0], [1, 0, 0], [0, value, 0]], [[0, 1, 2]])
    scene = mi.load_dict(seen(sail=sail))
    with pytest.raises(InputError, match="1 vertices of the shape sail are NaN or infinite"):
        check_scene(scene, 0, "here")


def test_sphere_without_a_size(tmp_path: Path) -> None:
    ball = '<shape type="sphere" id="ball"><float name="radius" value="nan"/></shape>'
    refused(file_with(tmp_path, "a.xml", xml(CAMERA, LIGHT, ball)), "shape ball has no finite")


def test_flat_triangles_are_counted() -> None:
    line = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    sail = python_mesh(line, [[0, 1, 3], [0, 1, 2], [0, 0, 3]])
    warnings = check_scene(mi.load_dict(seen(sail=sail)), 0, "here")
    assert warnings == ["2 zero-area triangles in sail skipped"]


def test_only_flat_triangles_are_no_geometry() -> None:
    sail = python_mesh([[0, 0, 0], [1, 0, 0], [3, 0, 0]], [[0, 1, 2]])
    with pytest.raises(InputError, match="no geometry"):
        check_scene(mi.load_dict(seen(sail=sail)), 0, "here")


def test_a_group_is_looked_into() -> None:
    sail = python_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]], [[0, 1, 2], [0, 1, 3]])
    group = {"type": "shapegroup", "sail": sail}
    scene = seen(group=group, copy={"type": "instance", "g": {"type": "ref", "id": "group"}})
    warnings = check_scene(mi.load_dict(scene), 0, "here")
    assert warnings == ["1 zero-area triangles in group.sail skipped"]


# Camera inside a wall ------------------------------------------------------------------------

GREY = {"type": "diffuse"}
TWO_SIDED = {"type": "twosided", "nested": {"type": "diffuse"}}
LAMP = {"type": "point", "position": [0.0, 0.5, 0.0]}


def boxed_in(bsdf: SceneDict, **objects: Any) -> mi.Scene:
    """Put a camera in the middle of a closed box of edge 2."""
    scene = seen(wall=solid_box((-1, -1, -1), (1, 1, 1), bsdf), **objects)
    scene["sensor"] = perspective((0, 0, 0), (0, 0, -1), 60)
    loaded: mi.Scene = mi.load_dict(scene)
    return loaded


@pytest.mark.parametrize("bsdf", [GREY, TWO_SIDED], ids=["one-sided", "two-sided"])
def test_camera_inside_a_wall(bsdf: SceneDict) -> None:
    with pytest.raises(InputError, match=r"camera is inside a wall .*back of wall.*move the cam"):
        check_scene(boxed_in(bsdf), 0, "here")


def test_one_sided_walls_stay_dark_with_a_lamp_inside() -> None:
    with pytest.raises(InputError, match="camera is inside a wall"):
        check_scene(boxed_in(GREY, lamp=LAMP), 0, "here")


def test_camera_stuck_in_a_wall_of_a_large_scene() -> None:
    ground = solid_box((-5000, -9, -5000), (5000, -8, 5000), GREY)
    with pytest.raises(InputError, match="camera is inside a wall"):
        check_scene(boxed_in(TWO_SIDED, lamp=LAMP, ground=ground), 0, "here")


def test_a_lit_room_with_two_sided_walls_is_no_wall() -> None:
    assert check_scene(boxed_in(TWO_SIDED, lamp=LAMP), 0, "here") == []


def test_a_camera_in_glass_is_no_fault() -> None:
    assert check_scene(boxed_in({"type": "dielectric"}), 0, "here") == []


def test_a_camera_in_a_dark_room_is_no_fault() -> None:
    scene = seen(
        wall=solid_box((-1, -1, -1), (1, 1, 1), diffuse(0.5, 0.5, 0.5)),
        lid={"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([0, 0, -0.5])},
    )
    scene["sensor"] = perspective((0, 0, 0), (0, 0, -1), 60)
    assert check_scene(mi.load_dict(scene), 0, "here") == []


# Resolution ----------------------------------------------------------------------------------


@pytest.mark.parametrize("resolution", [0, -4, (0, 8), (8, -1)])
def test_resolution_that_is_no_size(resolution: int | tuple[int, int]) -> None:
    refused("cornell_box", "not a picture size", resolution=resolution)


def test_resolution_with_a_crop(tmp_path: Path) -> None:
    film = """<film type="hdrfilm"><integer name="crop_width" value="4"/>
    <integer name="crop_height" value="4"/></film></sensor>"""
    path = file_with(tmp_path, "a.xml", xml(CAMERA.replace("</sensor>", film), LIGHT, BALL))
    refused(path, "crop window", resolution=8)
    assert dr.all(load_scene(str(path)).scene.sensors()[0].film().crop_size() == 4)
