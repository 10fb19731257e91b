"""Bounces with a gather that is known in closed form: every slot sees the mean of all slots."""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.slot_surfaces import SlotSurfaces
from vctgi.clipmap.storage import EmittanceClipmap
from vctgi.config import RenderConfig
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.stages.bounces import BouncedLight, BouncesConfig, bounce_light, reflect

pytestmark = pytest.mark.usefixtures("variant")

SLOT_COUNT = 40

ROUNDING = 1e-5
"""Relative: a few sums and products in single precision."""

ALL_OF_THEM = BouncesConfig(min_bounce_share=0.0)


def one_level() -> ClipmapLayout:
    return lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=0.25, level_count=1, resolution=8)


def slots(albedo: float) -> list[SlotSurfaces]:
    """Slots all over a level, of growing opacity."""
    layout = one_level()
    return [
        SlotSurfaces(
            level=layout.levels[0],
            index=70 * dr.arange(mi.UInt32, SLOT_COUNT) + 3,
            opacity=(dr.arange(mi.Float, SLOT_COUNT) + 1.0) / SLOT_COUNT,
            position=dr.zeros(mi.Point3f, SLOT_COUNT),
            normal=dr.zeros(mi.Vector3f, SLOT_COUNT),
            albedo=dr.full(mi.Color3f, albedo, SLOT_COUNT),
            unknown_share=0.0,
        )
    ]


def lit(radiance: float) -> EmittanceClipmap:
    """Slots of one radiance."""
    layout = one_level()
    empty = [dr.zeros(mi.Color3f, DIRECTION_COUNT * each.voxel_count) for each in layout.levels]
    dark = EmittanceClipmap(layout, empty, [0.0])
    return reflect(dark, slots(1.0), [dr.full(mi.Color3f, radiance, SLOT_COUNT)])


def furnace(emittance: EmittanceClipmap) -> Sequence[mi.Color3f]:
    """All slots see the mean radiance of all: the closed box."""
    (each,) = slots(1.0)
    held = dr.gather(mi.Color3f, emittance.levels[0], each.index)
    mean = mi.Color3f(*(dr.sum(channel) / dr.sum(each.opacity) for channel in held))
    return [mean + dr.zeros(mi.Color3f, SLOT_COUNT)]


def bounced(albedo: float, count: int, config: BouncesConfig = ALL_OF_THEM) -> BouncedLight:
    return bounce_light(lit(2.0), slots(albedo), furnace, count, config, keeps_parts=True)


def radiance_of(emittance: EmittanceClipmap) -> np.ndarray:
    (each,) = slots(1.0)
    held = dr.gather(mi.Color3f, emittance.levels[0], each.index)
    found: np.ndarray = np.array(held).T / np.array(each.opacity)[:, None]
    return found


@pytest.mark.parametrize("albedo", [0.2, 0.5, 0.95])
@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_bounces_add_up_to_the_geometric_sum(albedo: float, count: int) -> None:
    found = radiance_of(bounced(albedo, count).emittance)
    exact = 2.0 * (1.0 - albedo ** (count + 1)) / (1.0 - albedo)
    np.testing.assert_allclose(found, exact, rtol=ROUNDING)


def test_each_scattering_is_kept_apart_when_asked_for() -> None:
    light = bounced(0.5, 4)
    assert len(light.parts) == len(light.fluxes) == 5
    for number, part in enumerate(light.parts):
        np.testing.assert_allclose(radiance_of(part), 2.0 * 0.5**number, rtol=ROUNDING)
    assert not bounce_light(lit(2.0), slots(0.5), furnace, 4, ALL_OF_THEM).parts


def test_fluxes_are_those_of_the_slots() -> None:
    (each,) = slots(1.0)
    area = float(dr.sum(each.opacity)[0]) * each.level.voxel_size**2
    np.testing.assert_allclose(
        bounced(0.5, 3).fluxes, [np.pi * area * 2.0 * 0.5**k for k in range(4)], rtol=ROUNDING
    )


def test_a_small_bounce_is_the_last() -> None:
    # 1/2^n of the first against the sum of all before, 2 - 2/2^n: below 1/100 first at n = 6.
    light = bounced(0.5, 50, BouncesConfig(min_bounce_share=0.01))
    assert len(light.fluxes) == 1 + 6
    assert light.fluxes[-1] <= 0.01 * sum(light.fluxes[:-1])
    assert light.fluxes[-2] > 0.01 * sum(light.fluxes[:-2])


def test_black_surfaces_stop_at_once() -> None:
    light = bounced(0.0, 50)
    assert light.fluxes[1:] == [0.0]
    np.testing.assert_array_equal(radiance_of(light.emittance), radiance_of(lit(2.0)))


def test_no_light_comes_of_none() -> None:
    def never(emittance: EmittanceClipmap) -> Sequence[mi.Color3f]:
        raise AssertionError("darkness was gathered")

    light = bounce_light(lit(0.0), slots(0.9), never, 50, ALL_OF_THEM)
    assert light.fluxes == [0.0]
    assert not np.array(light.emittance.levels[0]).any()


def test_reflection_keeps_to_its_slots() -> None:
    (each,) = slots(0.5)
    found = reflect(lit(0.0), [each], [dr.full(mi.Color3f, 4.0, SLOT_COUNT)])
    is_lit = np.array(found.levels[0]).max(axis=0) > 0.0
    np.testing.assert_array_equal(np.flatnonzero(is_lit), np.sort(np.array(each.index)))


@pytest.mark.parametrize("share", [-0.1, 1.0, float("nan")])
def test_shares_that_are_none_are_refused(share: float) -> None:
    with pytest.raises(ValueError, match="min_bounce_share"):
        BouncesConfig(min_bounce_share=share)


@pytest.mark.parametrize("count", [-1, 0, 1])
def test_fewer_scatterings_than_indirect_light_has_are_refused(count: int) -> None:
    with pytest.raises(ValueError, match="scattering_count must be >= 2"):
        RenderConfig(scattering_count=count)
    assert RenderConfig().bounce_count == 0
