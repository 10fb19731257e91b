"""Emitters in voxels keep their power wherever they stand, however small they are."""

from __future__ import annotations

import math

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.hand_made_volumes import opacity_of
from tests.vctgi.small_scenes import SceneDict, area_light, camera, load, oblique, room
from vctgi.clipmap.levels import ClipmapConfig, lay_out_clipmap
from vctgi.clipmap.slots import DEFAULT_RULE
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap
from vctgi.clipmap.unpacking import unpack_level
from vctgi.config import RenderConfig
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.pipeline import light_volume, prepare_scene
from vctgi.scene.emissive import list_emissive_surfaces
from vctgi.stages.voxelization.emittance import voxelize_emission

pytestmark = pytest.mark.usefixtures("variant")

VOXEL_SIZE = 0.25
RADIANCE = 3.0

ANALYTIC = 1e-5
"""Relative. Areas are exact to 2^-32 of a face; vertices and radiance are single precision."""

FIXED_POINT_STEP = 4.0 * 2.0**-32
"""Radiance times area and area are rounded apart, to steps of 2^-32 of a face (times 4, the power
of two above the radiance)."""

QUADRATURE = 0.01
"""Relative. A texture is read once in each of the 64 cells of a face."""


def voxelized(light: SceneDict) -> tuple[OpacityClipmap, EmittanceClipmap]:
    layout = lay_out_clipmap(
        (0.0, 0.0, 0.0), finest_voxel_size=VOXEL_SIZE, level_count=2, resolution=16
    )
    shapes = [(DIRECTION_COUNT,) + (level.resolution,) * 3 for level in layout.levels]
    nothing = opacity_of(layout, [np.zeros(shape) for shape in shapes])
    return voxelize_emission(list_emissive_surfaces(load(light=light)), nothing)


def power(lit: EmittanceClipmap, level: int) -> float:
    """Radiance times projected area over all slots, W sr^-1."""
    size = lit.layout.levels[level].voxel_size
    return float(np.array(lit.levels[level], dtype=np.float64)[1].sum() * size**2)


def projected(normal: np.ndarray) -> float:
    """Faces that a unit of area fills over all slots; sloped surfaces also fill what is behind."""
    facing = np.abs(normal)
    return float(np.sum(facing * (1 + (facing < DEFAULT_RULE.sloped_below))))


def rectangle(to_world: mi.ScalarAffineTransform4f, emitter: SceneDict) -> SceneDict:
    return {"type": "rectangle", "to_world": to_world, "emitter": emitter}


@pytest.mark.parametrize("level", [0, 1])
@pytest.mark.parametrize("is_turned", [False, True], ids=["axis", "turned"])
def test_tiny_lamp_keeps_its_power_at_a_hundred_places(level: int, is_turned: bool) -> None:
    rng = np.random.default_rng(4)
    edge = 0.1 * VOXEL_SIZE
    found = []
    for _ in range(100 if level == 0 else 10):
        place = mi.ScalarTransform4f().translate(rng.uniform(-0.5, 0.5, 3).tolist())
        outer = place @ oblique() if is_turned else place
        opacity, lit = voxelized(rectangle(outer.scale(0.5 * edge), area_light(RADIANCE)))
        normal = np.array(outer.matrix, dtype=np.float64)[:3, 2]
        found.append(power(lit, level) / (RADIANCE * edge**2 * projected(normal)))
        emitted = np.array(lit.levels[level])[1]
        # Never brighter than what covers the face, so that it can be seen and gains nothing.
        bound = RADIANCE * np.array(opacity.levels[level]) * (1.0 + ANALYTIC)
        assert np.all(emitted <= bound + FIXED_POINT_STEP)
    np.testing.assert_allclose(found, 1.0, rtol=ANALYTIC)


def test_large_lamp_has_power_pi_times_what_its_slots_hold() -> None:
    scale = mi.ScalarTransform4f().translate([0.03, 0.01, 0.02]).scale([0.7, 0.9, 1.0])
    _, lit = voxelized(rectangle(scale, area_light(RADIANCE)))
    emitter_power = math.pi * RADIANCE * 1.4 * 1.8
    assert math.pi * power(lit, 0) == pytest.approx(emitter_power, rel=ANALYTIC)
    held = np.array(lit.levels[0])[1].reshape(DIRECTION_COUNT, -1).sum(axis=1)
    # Its front looks towards +z: rays that travel towards -z meet it.
    assert np.count_nonzero(held) == 1
    assert held[5] > 0.0


def test_texture_keeps_its_mean_and_its_place() -> None:
    values = np.zeros((2, 2, 3), dtype=np.float32)
    values[0, 0], values[1, 1] = 8.0, 2.0
    bitmap = {
        "type": "bitmap",
        "bitmap": mi.Bitmap(values),
        "raw": True,
        "filter_type": "nearest",
    }
    scale = mi.ScalarTransform4f().translate([0.0, 0.0, 0.1])
    _, lit = voxelized(rectangle(scale, {"type": "area", "radiance": bitmap}))
    assert power(lit, 0) == pytest.approx(2.5 * 4.0, rel=QUADRATURE)
    assert float(np.array(lit.levels[0]).max()) == pytest.approx(8.0, rel=ANALYTIC)


def test_scene_without_area_lights_emits_nothing() -> None:
    _, lit = voxelized({"type": "point", "intensity": 1.0})
    assert not np.array(lit.levels[0]).any()


def test_pipeline_writes_emitters_into_voxels_only_if_asked() -> None:
    down = mi.ScalarTransform4f().translate([0.0, 0.9, 0.0]).rotate([1, 0, 0], 90).scale(0.3)
    lamp = rectangle(down, area_light(RADIANCE))
    scene = load(lamp=lamp, sensor=camera([0.5, 0.3, 0.6], [0, 0, 0]), **room())
    brightest = []
    for is_asked in (False, True):
        config = RenderConfig(clipmap=ClipmapConfig(resolution=32), emission_in_voxels=is_asked)
        prepared = prepare_scene(scene, scene.sensors()[0], config)
        entry = next(e for e in prepared.plan.entries if e.item == "emission in voxels")
        assert entry.kept == is_asked
        volume = light_volume(prepared, config).volume
        # The finest window holds what the camera sees nearby, which need not be the lamp.
        texels = unpack_level(volume, volume.layout.coarsest)
        brightest.append(float(np.array(texels.emittance).max()))
    assert brightest[0] < 0.9 * RADIANCE < brightest[1]
