"""Oracle 8, second half: injected flux is the flux of the reflective shadow maps."""

from __future__ import annotations

import math

import mitsuba as mi
import numpy as np
import pytest

from tests.oracles.lights import FIXED_POINT, finite_lights, layout, shadow_maps, total
from tests.vctgi.hand_made_volumes import opacity_of
from tests.vctgi.small_scenes import grey, load, oblique, room
from vctgi.clipmap.slots import DEFAULT_RULE
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.light_injection import inject_light

pytestmark = pytest.mark.usefixtures("variant")


def injected_flux(maps: list[ReflectiveShadowMap]) -> tuple[np.ndarray, float]:
    """Radiance times face over all slots [channel], in W, and the share that was lost."""
    where = layout()
    shapes = [(DIRECTION_COUNT,) + (level.resolution,) * 3 for level in where.levels]
    everywhere = opacity_of(where, [np.ones(shape) for shape in shapes])
    lit = inject_light(maps, everywhere)
    face = where.finest_voxel_size**2
    return math.pi * face * total(lit.levels[0]), lit.lost_flux_share[0]


@pytest.mark.parametrize("name", ["point", "rectangle", "sphere"])
def test_injected_flux_is_rsm_flux_on_walls_along_the_axes(name: str) -> None:
    maps = shadow_maps(load(light=finite_lights()[name][0], **room()))
    found, lost = injected_flux(maps)
    # A wall across one axis fills one slot of a voxel.
    np.testing.assert_allclose(found, sum(total(m.reflected_flux) for m in maps), rtol=FIXED_POINT)
    assert lost == 0.0


@pytest.mark.parametrize("name", ["point", "sphere"])
def test_injected_flux_is_projected_rsm_flux_on_slanted_walls(name: str) -> None:
    maps = shadow_maps(load(light=finite_lights()[name][0], **room(oblique())))
    found, lost = injected_flux(maps)
    expected = np.zeros(3)
    for texels in maps:
        facing = np.abs(np.array(texels.normal, dtype=np.float64))
        # Sloped surfaces also fill the voxel behind, with the same radiance.
        copies = 1 + (facing < DEFAULT_RULE.sloped_below)
        expected += np.array(texels.reflected_flux, np.float64) @ (facing * copies).sum(axis=0)
    np.testing.assert_allclose(found, expected, rtol=FIXED_POINT)
    assert lost == 0.0


def test_light_outside_the_window_is_neither_injected_nor_called_lost() -> None:
    far = mi.ScalarTransform4f().translate([100.0, 0.0, 0.0])
    light = {"type": "point", "position": [100.0, 0.0, 0.0], "intensity": grey(3.0)}
    found, lost = injected_flux(shadow_maps(load(light=light, **room(far))))
    assert not found.any()
    assert lost == 0.0


def test_light_that_finds_no_opacity_is_counted_as_lost() -> None:
    maps = shadow_maps(load(light=finite_lights()["point"][0], **room()))
    where = layout()
    shapes = [(DIRECTION_COUNT,) + (level.resolution,) * 3 for level in where.levels]
    lit = inject_light(maps, opacity_of(where, [np.zeros(shape) for shape in shapes]))
    assert lit.lost_flux_share == [1.0]
    assert not np.array(lit.levels[0]).any()
