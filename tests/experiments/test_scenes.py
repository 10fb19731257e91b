"""The built-in scenes: what each promises holds in Mitsuba's own path tracer."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import numpy.typing as npt
import pytest

from experiments.scenes import BUILT_IN, load_scene
from experiments.scenes.catalogue import describe
from experiments.scenes.mesh_access import meshes
from experiments.scenes.parts import diffuse, solid_box

pytestmark = pytest.mark.usefixtures("variant")

SIZE_PX = 32
MID_GREY = (0.03, 0.4)
"""Median luminance of a picture that shows something at exposure 0 (0.18 is mid-grey)."""
FEW_SAMPLES_AGREE = 0.15
"""Relative: the mean of a 32 x 32 picture of 32 samples from run to run, with a wide margin."""
LARGEST_ESCAPE = 1e-5
"""Share of rays that may slip through the edges of a closed room; slits would let 1e-3 pass."""


def render(scene: mi.Scene, *, spp: int = 32) -> npt.NDArray[np.float64]:
    return np.array(mi.render(scene, spp=spp), dtype=np.float64)


def luminance(image: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.asarray(image @ np.array([0.2126, 0.7152, 0.0722]))


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_built_in_scene_passes_the_checks_without_a_warning(name: str) -> None:
    loaded = load_scene(name, resolution=SIZE_PX)
    assert loaded.warnings == []
    assert loaded.title
    assert loaded.purpose.startswith("Show ")
    assert "Parameters" not in loaded.purpose


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_built_in_scene_uses_the_box_filter_and_a_square_film(name: str) -> None:
    sensor = BUILT_IN[name].function()["sensor"]
    assert sensor["film"]["rfilter"] == {"type": "box"}
    assert sensor["film"]["width"] == sensor["film"]["height"]
    assert sensor["sampler"]["type"] == "independent"


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_picture_is_mid_grey_at_exposure_zero(name: str) -> None:
    picture = luminance(render(load_scene(name, resolution=SIZE_PX).scene))
    assert np.isfinite(picture).all()
    lit = picture[picture > 0]
    assert MID_GREY[0] < np.median(lit) < MID_GREY[1]


@pytest.mark.parametrize("name", ["sealed_rooms", "glossy_floor", "small_light", "corridor"])
def test_no_ray_escapes_from_a_closed_scene(name: str) -> None:
    scene: Any = load_scene(name, resolution=SIZE_PX).scene
    ray, _ = camera_rays(scene)
    hit = scene.ray_intersect(ray)
    assert dr.all(hit.is_valid())
    random = mi.PCG32(size=200_000)  # type: ignore[operator]
    index = mi.UInt32(random.next_float32() * dr.width(hit))
    start = dr.gather(mi.Vector3f, mi.Vector3f(hit.p), index)
    normal = dr.gather(mi.Vector3f, mi.Vector3f(hit.n), index)
    sample = mi.Point2f(random.next_float32(), random.next_float32())
    direction = mi.Frame3f(normal).to_world(mi.warp.square_to_uniform_hemisphere(sample))
    into_open: Any = dr.gather(mi.Bool, dr.dot(mi.Vector3f(hit.n), ray.d) < 0, index)
    bounced = scene.ray_intersect(mi.Ray3f(mi.Point3f(start + 1e-4 * normal), direction), into_open)
    escaped = int(np.sum(~np.array(bounced.is_valid()) & np.array(into_open)))
    assert escaped / 200_000 < LARGEST_ESCAPE


def camera_rays(scene: mi.Scene, width: int = 64) -> Any:
    sensor: Any = scene.sensors()[0]
    index = dr.arange(mi.UInt32, width**2)
    position = (mi.Point2f(index % width, index // width) + 0.5) / width
    return sensor.sample_ray(0.0, 0.5, position, mi.Point2f(0.5))


def room_of_pixels(scene: mi.Scene, turn: float = 0.0) -> npt.NDArray[np.float64]:
    """Where the seen points lie along the axis from the lit to the dark room, [pixel]."""
    ray, _ = camera_rays(scene)
    points = np.array(scene.ray_intersect(ray).p)
    return np.asarray(points[0] * math.cos(turn) - points[2] * math.sin(turn))


@pytest.mark.parametrize("wall_thickness", [0.02, 0.2, 1.0])
@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_the_dark_room_is_exactly_black_beside_the_lit_one(
    wall_thickness: float, turn: float
) -> None:
    loaded = load_scene(
        "sealed_rooms",
        resolution=64,
        parameters={"wall_thickness": str(wall_thickness), "turn": str(turn)},
    )
    picture = luminance(render(loaded.scene, spp=64)).ravel()
    across = room_of_pixels(loaded.scene, turn)
    margin = 0.1
    in_dark_room = across > wall_thickness / 2 + margin
    in_lit_room = across < -wall_thickness / 2 - margin
    assert in_dark_room.mean() > 0.25
    assert in_lit_room.mean() > 0.25
    assert picture[in_dark_room].max() == 0.0
    assert picture[in_lit_room].mean() > 0.05


def test_turning_the_sealed_rooms_keeps_the_picture() -> None:
    straight = render(load_scene("sealed_rooms", resolution=SIZE_PX).scene)
    turned = render(
        load_scene("sealed_rooms", resolution=SIZE_PX, parameters={"turn": "0.7"}).scene
    )
    assert turned.mean() == pytest.approx(straight.mean(), rel=FEW_SAMPLES_AGREE)


def test_a_partition_that_fills_the_rooms_is_refused() -> None:
    with pytest.raises(ValueError, match="wall_thickness must be in"):
        BUILT_IN["sealed_rooms"].function(wall_thickness=5.0)


@pytest.mark.parametrize("alpha", [0.0, 1.5])
def test_a_floor_outside_the_range_of_alpha_is_refused(alpha: float) -> None:
    with pytest.raises(ValueError, match="alpha must be in"):
        BUILT_IN["glossy_floor"].function(alpha=alpha)


def test_the_stripes_run_upwards() -> None:
    scene = load_scene("glossy_floor").scene
    x = dr.linspace(mi.Float, -2.9, 2.9, 241)
    rows = []
    for y in (2.0, 3.0):
        ray = mi.Ray3f(mi.Point3f(x, y, -4.0), mi.Vector3f(0, 0, -1))
        hit: Any = scene.ray_intersect(ray)
        rows.append(np.array(hit.bsdf().eval_diffuse_reflectance(hit))[0])
    assert np.array_equal(rows[0], rows[1])
    assert np.count_nonzero(np.diff(rows[0])) == 11


def test_an_offset_moves_object_and_light() -> None:
    function = BUILT_IN["small_light"].function
    shift = (0.01, -0.02, 0.03)
    before = function()
    after = function(light_offset=shift, object_offset=shift)
    for name in ("object", "light"):
        moved = np.array((after[name]["to_world"]).matrix) - np.array(
            (before[name]["to_world"]).matrix
        )
        expected = np.zeros((4, 4))
        expected[:3, 3] = shift
        assert moved == pytest.approx(expected, abs=1e-6)


def test_the_corridor_is_a_hundred_metres_long_and_lit_to_its_end() -> None:
    scene = load_scene("corridor").scene
    extents = np.array(scene.bbox().extents())
    assert extents[2] == pytest.approx(100.0, abs=1.0)
    centres = [(0.0, 1.5, -10.0 * room - 8.0) for room in range(10)]
    path: Any = mi.load_dict({"type": "path", "max_depth": 6})
    sampler: Any = mi.load_dict({"type": "independent"})
    for centre in centres:
        sampler.seed(0, 4096)
        direction = mi.warp.square_to_uniform_sphere(sampler.next_2d())
        ray = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(*centre), direction))
        radiance, _, _ = path.sample(scene, sampler, ray)
        assert np.array(radiance).mean() > 1e-3


@pytest.mark.parametrize("name", ["sealed_rooms", "corridor", "open_sky"])
def test_solids_are_closed_and_face_outwards(name: str) -> None:
    for mesh in meshes(load_scene(name).scene):
        corners = mesh.positions.astype(np.float64)[mesh.faces]
        centred = corners - corners.mean(axis=(0, 1))
        volume = np.linalg.det(centred).sum() / 6
        if len(mesh.faces) == 12:
            size = np.prod(np.ptp(corners.reshape(-1, 3), axis=0))
            assert volume == pytest.approx(size, rel=1e-4)


def test_a_box_turned_inside_out_is_refused() -> None:
    with pytest.raises(ValueError, match="low must be below high"):
        solid_box((0, 0, 0), (1, -1, 1), diffuse(0.5, 0.5, 0.5))


def test_describe_takes_the_prose_before_the_first_section() -> None:
    def documented() -> None:
        """Show one thing.

        And more
        of it.

        Parameters
        ----------
        nothing
        """

    assert describe(documented) == "Show one thing. And more of it."
    assert describe(lambda: None) == ""
