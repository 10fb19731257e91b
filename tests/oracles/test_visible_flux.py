"""The flux that rays can see: what was injected where nothing is seen is found missing here.

Rays along the six directions cross the whole clipmap, closely spaced. What they bring home, times
the area that each stands for, is the power that leaves the surfaces towards that direction. The sum
of what was injected cannot tell: emittance without opacity has a sum, and no ray sees it.
"""

from __future__ import annotations

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from experiments.studies.light.visible_flux import leaving_flux, seen_flux
from tests.oracles.lights import finite_lights, layout, shadow_maps
from tests.vctgi.small_scenes import camera, load, oblique, room
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.config import RenderConfig
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.pipeline import prepare_scene
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.stages.light_injection import LightInjectionConfig, inject_light
from vctgi.stages.outgoing_radiance import with_radiance
from vctgi.stages.voxelization.opacity import voxelize_opacity

pytestmark = pytest.mark.usefixtures("variant")

FACING_WALLS = 0.01
"""Relative. An opaque voxel lets exp(-6) = 0.25 % through, steps cut the profile of a wall, and
interpolation bends along the room's edges."""

SLANTED_WALLS = 0.06
"""Relative. The parts of a slanted wall that complement each other are seen as if independent."""

BLIND_LOSS = 0.1
"""Least share that a pre-filter loses which writes without looking for coverage: 11 % where slanted
walls are thickened, and beyond all tolerances above."""


def lit_room(*, is_turned: bool) -> tuple[list[ReflectiveShadowMap], OpacityClipmap]:
    parts = room(oblique() if is_turned else None)
    scene = load(
        light=finite_lights()["point"][0], sensor=camera([0.5, 0.4, 0.6], [0, 0, 0]), **parts
    )
    surfaces = prepare_scene(scene, scene.sensors()[0], RenderConfig()).surfaces
    return with_radiance(scene, shadow_maps(scene), 1), voxelize_opacity(surfaces, layout())


CONFIGS = {
    "scatter": LightInjectionConfig(),
    "gather, 3 wide": LightInjectionConfig(algorithm="gather", prefilter=3),
    "scatter, 5 wide": LightInjectionConfig(prefilter=5),
}


@pytest.mark.parametrize("name", CONFIGS)
def test_rays_see_all_flux_of_walls_along_the_axes(name: str) -> None:
    maps, opacity = lit_room(is_turned=False)
    seen = seen_flux(opacity, inject_light(maps, opacity, CONFIGS[name]))
    np.testing.assert_allclose(seen, leaving_flux(maps), rtol=FACING_WALLS)


@pytest.mark.parametrize("name", CONFIGS)
def test_rays_see_the_flux_of_slanted_walls(name: str) -> None:
    maps, opacity = lit_room(is_turned=True)
    seen = seen_flux(opacity, inject_light(maps, opacity, CONFIGS[name]))
    np.testing.assert_allclose(seen.sum(), leaving_flux(maps).sum(), rtol=SLANTED_WALLS)


@pytest.mark.parametrize("is_turned", [False, True], ids=["axis", "turned"])
def test_blind_pre_filter_keeps_its_sum_and_loses_what_rays_see(is_turned: bool) -> None:
    maps, opacity = lit_room(is_turned=is_turned)
    lit = inject_light(maps, opacity)
    sharp = seen_flux(opacity, lit).sum()
    size = opacity.layout.levels[0].resolution
    color = np.array(lit.levels[0], dtype=np.float64).reshape(3, DIRECTION_COUNT, size, size, size)
    before = color.sum()
    for axis in (2, 3, 4):
        low, high = (np.roll(color, step, axis) for step in (-1, 1))
        color = 0.5 * color + 0.25 * (low + high)
    assert color.sum() == pytest.approx(before, rel=1e-6)
    blind = mi.Color3f(np.ascontiguousarray(color.reshape(3, -1), dtype=np.float32))
    blurred = replace(lit, levels=[blind, *lit.levels[1:]])
    assert seen_flux(opacity, blurred).sum() <= (1.0 - BLIND_LOSS) * sharp


def test_bounded_light_is_never_brighter_than_the_surfaces() -> None:
    maps, opacity = lit_room(is_turned=True)
    config = LightInjectionConfig(normalisation="radiance")
    lit = np.array(inject_light(maps, opacity, config).levels[0])[1]
    # One small lamp: each estimate is exact, so the bound is that of the brightest point.
    brightest = max(float(np.array(m.radiance)[1].max()) for m in maps)
    assert np.all(lit <= 1.0001 * brightest * np.array(opacity.levels[0]))
