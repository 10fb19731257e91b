"""Packing lanes loses none, makes none, and changes no picture."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import vctgi
from experiments.scenes import load_scene
from vctgi.clipmap.storage import VoxelVolume
from vctgi.stages.cone_tracing import specular
from vctgi.stages.cone_tracing.packed_lanes import pack_lanes

pytestmark = pytest.mark.usefixtures("variant")


@pytest.mark.parametrize("share", [0.0, 0.03, 0.5, 1.0])
def test_each_active_lane_is_somebodys_work(share: float) -> None:
    width = 100_000
    wanted = np.random.default_rng(3).random(width) < share
    packed = pack_lanes(mi.Bool(wanted), width)
    source, active = np.array(packed.source), np.array(packed.active)
    count = int(wanted.sum())
    assert active[:count].all()
    assert not active[count:].any()
    np.testing.assert_array_equal(np.sort(source[:count]), np.flatnonzero(wanted))


def test_it_can_be_recorded() -> None:
    def doubled(active: mi.Bool, values: mi.Float) -> mi.Float:
        width = dr.width(values)
        packed = pack_lanes(active, width)
        found = dr.zeros(mi.Float, width)
        own = dr.gather(mi.Float, values, packed.source, packed.active)
        dr.scatter(found, 2.0 * own, packed.source, packed.active)
        return found

    recorded = dr.freeze(doubled)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        active, values = rng.random(5000) < 0.1 * (1 + seed), rng.random(5000)
        found = np.array(recorded(mi.Bool(active), mi.Float(values)))
        np.testing.assert_array_equal(found, np.where(active, 2.0 * np.float32(values), 0.0))


@pytest.mark.parametrize("name", ["glossy_floor", "open_sky"])
def test_specular_light_is_the_same_without_packing(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded = load_scene(name, resolution=(24, 18))
    config = vctgi.preset("high")
    config = replace(config, samples_per_pixel=1, clipmap=replace(config.clipmap, resolution=16))
    sensor = loaded.scene.sensors()[loaded.sensor_index]
    prepared = vctgi.prepare_scene(loaded.scene, sensor, config)
    assert prepared.plan.has_specular or prepared.plan.has_passing
    volume = vctgi.light_volume(prepared, config).volume

    found = [np.array(vctgi.render_frame(prepared, volume, config, seed=2).indirect_specular)]
    # Where anything has derivatives each point keeps its lane.
    monkeypatch.setattr(VoxelVolume, "has_derivatives", property(lambda _: True))
    monkeypatch.setattr(specular, "pack_lanes", None)
    found.append(np.array(vctgi.render_frame(prepared, volume, config, seed=2).indirect_specular))
    assert found[0].any()
    np.testing.assert_array_equal(found[0], found[1])
