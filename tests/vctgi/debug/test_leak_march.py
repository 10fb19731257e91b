"""The march that judges its own light: equal to the renderer's, and right where leaks are known."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from experiments.studies import scenes
from experiments.studies.exact_voxels import lay_out_window, light_exactly, scene_of
from experiments.studies.tracers import constant_radiance
from vctgi.clipmap.storage import VoxelVolume
from vctgi.debug.leak_march import Cones, LeakSample, Probes, march_with_probes
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig, diffuse_lanes
from vctgi.stages.cone_tracing.lane_order import cone_after_cone
from vctgi.stages.cone_tracing.march import ConeMarchConfig, march_cone

pytestmark = pytest.mark.usefixtures("variant")

ROUNDING = 1e-6
"""Sums of single-precision numbers near 1, in another order."""

CHANCE = 5.0
"""Standard errors by which a share of choices may differ from its expectation."""

CONES = DiffuseConesConfig(cone_count=17)


def furnace() -> tuple[VoxelVolume, Cones]:
    """Return a closed box of radiance 1, and cones from its faces."""
    scene = scenes.white_furnace(3, seed=1)
    layout = lay_out_window(scene.triangles)
    volume = light_exactly(scene_of(scene.triangles), layout, constant_radiance(scene.radiance))
    at, cones = white_receivers(scene.points, scene.normals), CONES.cones()
    table = cone_after_cone(len(scene.points), cones.cone_count)
    lanes = diffuse_lanes(at, volume, cones, CONES, table)
    nothing = dr.zeros(mi.Float, dr.width(lanes.ratio))
    return volume, Cones(lanes.apex, lanes.axis, lanes.ratio, lanes.phase, nothing)


def marched(volume: VoxelVolume, cones: Cones, distances: list[float], seed: int = 0) -> LeakSample:
    """March with probes of equal shares that end at these distances."""
    width = dr.width(cones.ratio)
    probes = Probes(
        [dr.full(mi.Float, each, width) for each in distances],
        [dr.full(mi.Float, 1.0 / len(distances), width) for _ in distances],
    )
    active = dr.full(mi.Bool, True, width)
    return march_with_probes(volume, cones, probes, CONES.march, active, seed)


def test_radiance_and_transmittance_are_those_of_the_renderers_march() -> None:
    volume, cones = furnace()
    active = dr.full(mi.Bool, True, dr.width(cones.ratio))
    renderers = march_cone(
        volume, cones.apex, cones.axis, cones.ratio, cones.phase, CONES.march, active
    )
    own = marched(volume, cones, [np.inf])
    np.testing.assert_allclose(np.array(own.radiance), np.array(renderers.radiance), atol=ROUNDING)
    np.testing.assert_allclose(
        np.array(own.transmittance), np.array(renderers.transmittance), atol=ROUNDING
    )


def test_nothing_came_through_where_every_probe_goes_on() -> None:
    found = marched(*furnace(), [np.inf, np.inf])
    for part in (found.through, found.hidden, found.blocked):
        assert np.array(part).max() <= ROUNDING


def test_all_came_through_where_every_probe_ends_at_once() -> None:
    # So early that the reach behind a surface does not bridge it: everything is hidden
    found = marched(*furnace(), [-10.0])
    whole = np.array(found.radiance)
    for part in (found.through, found.hidden, found.blocked):
        np.testing.assert_allclose(np.array(part), whole, atol=ROUNDING)


def test_bounds_hold_and_a_blocked_share_is_that_of_the_probes() -> None:
    found = marched(*furnace(), [-10.0, np.inf, np.inf, np.inf])
    whole, hidden, through, blocked = (
        np.array(each) for each in (found.radiance, found.hidden, found.through, found.blocked)
    )
    np.testing.assert_allclose(blocked, 0.25 * whole, atol=ROUNDING)
    assert hidden.max() <= ROUNDING
    assert (through <= blocked + ROUNDING).all()
    # Where the voxels have let less than three quarters pass, they let none too much pass.
    assert through.sum() < blocked.sum()


def test_the_chosen_step_is_chosen_by_its_light() -> None:
    volume, cones = furnace()
    edge = 1.0
    found = marched(volume, cones, [edge])
    shares = np.array(found.blocked)[0] / np.array(found.radiance)[0]
    picks = []
    for seed in range(40):
        choice = marched(volume, cones, [edge], seed)
        picks.append(np.array(choice.chosen_t) - np.array(choice.chosen_reach) > edge)
    rates = np.mean(picks, axis=0)
    error = np.sqrt((shares * (1.0 - shares)).sum() / 40.0)
    assert 0.1 < shares.mean() < 0.9
    assert abs(rates.sum() - shares.sum()) < CHANCE * error


def test_a_march_that_gathers_no_light_is_refused() -> None:
    volume, cones = furnace()
    march = replace(ConeMarchConfig(), falloff_length=1.0)
    with pytest.raises(ValueError, match="falloff_length"):
        march_with_probes(volume, cones, Probes([], []), march, mi.Bool(True), 0)
