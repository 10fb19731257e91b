"""The benchmark's instruments: what they count is there, and they count all of it."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import pytest

import vctgi
from experiments.bench.floors import floor_ms
from experiments.bench.kernels import APPLICATION, COMPOSITE, INJECTION, TRACING, KernelClock
from experiments.bench.measure import BenchOptions, bench_config
from experiments.bench.reads import bare_fetch, counting
from experiments.bench.walks import CAMERA, LIGHTS, STILL, TURN_FRAMES, Walk
from experiments.scenes import load_scene
from reports.bench_record import Rates
from vctgi.clipmap.storage import StorageConfig
from vctgi.clipmap.stored_directions import SIX
from vctgi.clipmap.texel_choice import Filtering
from vctgi.clipmap.texture_target import build_texture
from vctgi.clipmap.unpacking import unpack_level

pytestmark = pytest.mark.usefixtures("variant")

TAPS_PER_SAMPLE: dict[Filtering, int] = {"linear": 48, "random_level": 24, "random_texel": 3}
"""Two levels, three axes, two layers, four texels; one level; one texel of each axis."""

SMALL_SHARE = 1e-3
"""Of the largest texel: places in a texture are rounded to single precision."""

SMALL = BenchOptions(frames=1, resolution=16, level_count=2)


def walk(kind: str, scene: str = "cornell_box", filtering: Filtering = "random_level") -> Walk:
    loaded = load_scene(scene, resolution=(12, 8))
    config = bench_config(vctgi.preset("medium"), SMALL)
    march = replace(config.diffuse.march, filtering=filtering)
    diffuse = replace(config.diffuse, near_field_voxels=0.0, march=march)
    config = replace(config, diffuse=diffuse, storage=StorageConfig())
    return Walk(vctgi.prepare_scene(loaded.scene, loaded.scene.sensors()[0], config), config, kind)


@pytest.mark.parametrize("filtering", TAPS_PER_SAMPLE)
def test_reads_are_those_of_the_samples(filtering: Filtering) -> None:
    still = walk(STILL, filtering=filtering)
    volume, take_count = counting(still.volume)
    clock = KernelClock(take_count)
    with clock.watched() as work:
        tally = still.count(volume, clock)
    assert tally.gathering.sample_count > 0
    most = TAPS_PER_SAMPLE[filtering] * tally.gathering.sample_count
    if filtering == "random_texel":
        # Voxels outside of the window are not asked for, and this one is small.
        assert 0.5 * most < work[TRACING].reads <= most
    else:
        assert work[TRACING].reads == most


def test_a_bare_fetch_reads_every_texel_of_a_power_of_two() -> None:
    volume = walk(STILL).volume
    levels = list(volume.layout.levels)
    # In units of 1, as the words are.
    is_empty = [False] * len(levels)
    one = mi.Float(1.0)
    texture = build_texture(levels, is_empty, lambda level: unpack_level(volume, level), SIX, one)
    for texels, words in (
        (volume.texels, volume.texels.words),  # type: ignore[attr-defined]
        (texture, mi.Float(texture.texture.tensor().array)),
    ):
        place = dr.arange(mi.UInt32, 4096)
        found = bare_fetch(texels)(place)
        held = dr.gather(mi.Vector4f, words, place)
        assert dr.max(held, axis=None) > 0.0
        assert dr.max(dr.abs(found - held), axis=None) < SMALL_SHARE * dr.max(held, axis=None)


def test_counting_changes_nothing() -> None:
    still = walk(STILL)
    frame = still.frame(0).frame
    volume, _ = counting(still.volume)
    counted = vctgi.render_frame(still.prepared, volume, still.config, seed=0)
    assert dr.all(frame.indirect_diffuse.array == counted.indirect_diffuse.array)


def test_work_belongs_to_the_stage_that_is_open() -> None:
    clock = KernelClock()
    with clock.watched() as work:
        with clock("diffuse cones"):
            dr.eval(dr.arange(mi.Float, 1000) + dr.opaque(mi.Float, 1.0))
            with clock("G-buffer"):
                dr.eval(dr.arange(mi.Float, 1001) + dr.opaque(mi.Float, 1.0))
        with clock("a stage of light with no line of its own"):
            dr.eval(dr.arange(mi.Float, 1002) + dr.opaque(mi.Float, 1.0))
        dr.eval(dr.arange(mi.Float, 1003) + dr.opaque(mi.Float, 1.0))
    assert set(work) == {TRACING, APPLICATION, INJECTION, COMPOSITE}
    assert all(each.launches > 0 and each.operations > 0 for each in work.values())


def test_a_camera_goes_and_comes_back_with_its_windows() -> None:
    moving = walk(CAMERA, "corridor")
    eye = moving.prepared.sensor.world_transform().translation()
    before = [float(each[0]) for each in eye]
    moved = moving.frame(TURN_FRAMES // 4)
    assert moved.filled_count > 0
    after = [float(each[0]) for each in moving.prepared.sensor.world_transform().translation()]
    assert after != before
    moving.put_back()
    back = [float(each[0]) for each in moving.prepared.sensor.world_transform().translation()]
    assert back == pytest.approx(before, abs=1e-6)


def test_a_moving_light_lights_all_voxels_again() -> None:
    moving = walk(LIGHTS)
    found = moving.frame(1)
    assert found.texel_count > 0
    assert found.filled_count == 0


def test_a_floor_is_reads_and_bytes_at_the_machines_rates() -> None:
    rates = Rates(coherent_reads=1e9, random_reads=1e8, copied_bytes=1e10)
    assert floor_ms(1_000_000, 10_000_000, rates) == pytest.approx(2.0)
