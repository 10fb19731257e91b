"""Loading: every kind of source, resolution, parameters, credit."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import numpy.typing as npt
import pytest

from experiments.errors import InputError
from experiments.scenes import load_scene
from experiments.scenes.mesh_access import triangle_count
from experiments.scenes.mesh_files import DEFAULT_LIGHT_WARNING

pytestmark = pytest.mark.usefixtures("variant")

SINGLE_PRECISION = 1e-6

XML = """<scene version="3.0.0">
  <default name="albedo" value="0.5"/>
  <default name="width" value="60"/>
  <sensor type="perspective">
    <float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm">
      <integer name="width" value="$width"/><integer name="height" value="30"/>
    </film>
  </sensor>
  <shape type="sphere" id="ball">
    <bsdf type="diffuse"><rgb name="reflectance" value="$albedo"/></bsdf>
  </shape>
  <emitter type="constant"/>
</scene>"""

PYTHON = '''"""A scene of a test.

Not this paragraph.
"""


def scene(radius: float = 1.0, count: int = 1, centre: tuple = (0.0, 0.0, 0.0)) -> dict:
    import mitsuba as mi

    return {
        "type": "scene",
        "ball": {"type": "sphere", "radius": radius, "center": list(centre)},
        "light": {"type": "constant"},
        "sensor": {
            "type": "perspective",
            "to_world": mi.ScalarTransform4f().look_at([0, 0, 9], [0, 0, 0], [0, 1, 0]),
        },
    }
'''

OBJ = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"


def shared_scenes() -> list[Path]:
    """Find scenes in the folder named by VCTGI_SCENES, or the one beside the repository."""
    beside = Path(__file__).parents[2].parent / "shared" / "scenes"
    return sorted(Path(os.environ.get("VCTGI_SCENES", beside)).glob("*/*.xml"))


def write(path: Path, text: str) -> str:
    path.write_text(text, encoding="utf-8")
    return str(path)


def film_size(scene: mi.Scene) -> tuple[int, ...]:
    return tuple(int(edge) for edge in scene.sensors()[0].film().size())


FILTER_ORDER = 1e-5
"""Mitsuba's default film filter adds a pixel's samples in no fixed order, in single precision."""


def view_edge(scene: mi.Scene) -> npt.NDArray[np.float64]:
    """Direction through the middle of the right edge of the film."""
    sensor: Any = scene.sensors()[0]
    ray, _ = sensor.sample_ray(0.0, 0.5, mi.Point2f(1.0, 0.5), mi.Point2f(0.5))
    return np.array(ray.d)[:, 0]


# XML and Python ------------------------------------------------------------------------------


def test_an_xml_scene_takes_its_parameters(tmp_path: Path) -> None:
    source = write(tmp_path / "ball.xml", XML)
    loaded = load_scene(source, parameters={"albedo": "0.25", "width": "50"})
    assert film_size(loaded.scene) == (50, 30)
    albedo = np.array(mi.traverse(loaded.scene)["ball.bsdf.reflectance.value"])
    assert albedo.ravel() == pytest.approx(0.25)
    assert (loaded.name, loaded.title, loaded.source) == ("ball", "Ball", source)
    assert loaded.credit == ""


@pytest.mark.parametrize(
    ("resolution", "expected"),
    [(None, (60, 30)), (20, (20, 10)), ((16, 16), (16, 16)), ((7, 31), (7, 31))],
)
def test_resolution_changes_the_film_and_keeps_the_view(
    tmp_path: Path, resolution: int | tuple[int, int] | None, expected: tuple[int, int]
) -> None:
    source = write(tmp_path / "ball.xml", XML)
    before, after = load_scene(source).scene, load_scene(source, resolution=resolution).scene
    assert film_size(after) == expected
    depth: Any = mi.load_dict({"type": "depth"})
    assert np.array(mi.render(after, integrator=depth, spp=1)).shape[:2] == expected[::-1]
    assert view_edge(after) == pytest.approx(view_edge(before), abs=SINGLE_PRECISION)


def test_a_resized_camera_sees_what_one_of_that_size_sees(tmp_path: Path) -> None:
    source = write(tmp_path / "ball.xml", XML)
    resized = load_scene(source, resolution=(30, 30)).scene
    made = load_scene(source, parameters={"width": "30"}).scene
    depth: Any = mi.load_dict({"type": "depth"})
    pictures = [np.array(mi.render(s, integrator=depth, spp=4)) for s in (resized, made)]
    assert pictures[0].max() > 0.0
    assert pictures[0] == pytest.approx(pictures[1], rel=FILTER_ORDER, abs=FILTER_ORDER)


def test_a_second_camera_can_be_chosen(tmp_path: Path) -> None:
    second = XML.replace("</scene>", '<sensor type="perspective" id="b"/></scene>')
    second = second.replace('id="b"/>', 'id="b"><transform name="to_world"><translate z="-9"/>')
    second = second.replace('z="-9"/></scene>', 'z="-9"/></transform></sensor></scene>')
    loaded = load_scene(write(tmp_path / "two.xml", second), sensor_index=1, resolution=(9, 9))
    sizes = [tuple(int(e) for e in sensor.film().size()) for sensor in loaded.scene.sensors()]
    assert loaded.sensor_index == 1
    assert sizes == [(60, 30), (9, 9)]


def test_a_python_scene_takes_typed_arguments(tmp_path: Path) -> None:
    source = write(tmp_path / "my_ball.py", PYTHON)
    loaded = load_scene(source, parameters={"radius": "2", "count": "3", "centre": "1, 0, 0"})
    assert np.array(loaded.scene.bbox().extents()) == pytest.approx([4, 4, 4])
    assert np.array(loaded.scene.bbox().center()) == pytest.approx([1, 0, 0])
    assert (loaded.name, loaded.title, loaded.purpose) == (
        "my_ball",
        "My ball",
        "A scene of a test.",
    )


def test_a_python_scene_finds_files_beside_it(tmp_path: Path) -> None:
    (tmp_path / "square.obj").write_text(OBJ)
    text = PYTHON.replace('{"type": "sphere", "radius": radius, "center": list(centre)}', "MESH")
    text = text.replace("MESH", '{"type": "obj", "filename": "square.obj"}')
    assert triangle_count(load_scene(write(tmp_path / "a.py", text)).scene) == 2


def test_notes_beside_a_scene_become_its_credit(tmp_path: Path) -> None:
    folder = tmp_path / "red-room"
    folder.mkdir()
    (folder / "README.md").write_text(
        "# The Red Room\n\n- Author: A. Painter\n- Licence: CC BY 3.0 (example.org/by) Text here.\n"
        "\n## What it exercises\n\nRed light,\nand more.\n\n## Changes\n\nNone.\n"
    )
    loaded = load_scene(write(folder / "scene.xml", XML))
    assert loaded.name == "red-room"
    assert loaded.title == "The Red Room"
    assert loaded.credit == "A. Painter, CC BY 3.0 (example.org/by)"
    assert loaded.purpose == "Red light, and more."
    other = load_scene(write(folder / "scene_blue_light.xml", XML))
    assert (other.name, other.title) == ("red-room-blue-light", "The Red Room (blue light)")


def test_a_text_about_something_else_is_no_credit(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("# My project\n\n- Author: me\n")
    loaded = load_scene(write(tmp_path / "ball.xml", XML))
    assert (loaded.title, loaded.credit) == ("Ball", "")


def test_what_mitsuba_warns_of_is_kept_and_not_printed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    stretched = XML.replace(
        'id="ball">', 'id="ball"><transform name="to_world"><scale x="2"/></transform>'
    )
    loaded = load_scene(write(tmp_path / "ball.xml", stretched))
    assert len(loaded.warnings) == 1
    assert "non-uniform scaling" in loaded.warnings[0]
    assert "non-uniform" not in "".join(capfd.readouterr())


# Meshes --------------------------------------------------------------------------------------


def test_a_bare_mesh_is_lit_and_framed(tmp_path: Path) -> None:
    source = write(tmp_path / "square.obj", "mtllib a.mtl\n" + OBJ.replace("1 1 0", "1 1 1"))
    loaded = load_scene(source, resolution=32)
    assert loaded.warnings == [
        "OBJ materials ignored: all surfaces are grey",
        DEFAULT_LIGHT_WARNING,
    ]
    sensor: Any = loaded.scene.sensors()[0]
    corners = np.array(
        [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float32
    )
    local = sensor.world_transform().inverse() @ mi.Point3f(corners.T)
    tangent = np.abs(np.array(local)[:2]).max(axis=0) / np.array(local)[2]
    assert tangent.max() < np.tan(np.radians(20.0))
    assert np.array(mi.render(loaded.scene, spp=4)).mean() > 0.1


def test_a_mesh_file_has_no_parameters(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no parameters.*leave out albedo"):
        load_scene(write(tmp_path / "a.obj", OBJ), parameters={"albedo": "1"})


# Scenes that are not part of the repository --------------------------------------------------


@pytest.mark.skipif(
    not shared_scenes(),
    reason="no scene collection: set VCTGI_SCENES to a folder of NAME/scene.xml",
)
@pytest.mark.parametrize(
    "path", shared_scenes(), ids=lambda path: f"{path.parent.name}-{path.stem}"
)
def test_a_collected_scene_loads_with_its_credit(path: Path) -> None:
    loaded = load_scene(str(path), resolution=16)
    assert film_size(loaded.scene) == (16, 16)
    assert triangle_count(loaded.scene) > 0
    assert loaded.credit
