"""The study "pareto": its competitor has the reference's transport, its clocks are warm."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import reference
import vctgi
from experiments.clocks import (
    REPETITIONS,
    WARM_FRAMES,
    Clocks,
    FrameTime,
    Job,
    NeverWarmError,
    Render,
    time_jobs,
    timed_frame,
)
from experiments.scenes import LoadedScene, load_scene
from experiments.studies.check import Measured, StudyContext
from experiments.studies.figures import FigureShelf
from experiments.studies.pareto import bench, checks
from experiments.studies.pareto.bench import COUNT, Bench, Result, has_denoiser, run_methods
from experiments.studies.pareto.cone_frames import (
    CAMERA,
    FRAMES,
    LIGHTS,
    STILL,
    LitScene,
    indirect_image,
    light_key,
)
from experiments.studies.pareto.figures import draw
from experiments.studies.pareto.methods import (
    FAMILIES,
    GRID,
    HIGH,
    OURS,
    PATHS,
    PRESET_NAMES,
    RECIPES,
    Method,
    cone_methods,
    methods,
    path_name,
)
from experiments.studies.pareto.path_tracing import PathTracer
from experiments.studies.pareto.scores import Truth, score
from reference import NoiseFloor
from reports.study_figures import ScatterFigure, TableFigure
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.config import RenderConfig, preset
from vctgi.peers import peer_names
from vctgi.pipeline import Frame

pytestmark = pytest.mark.usefixtures("variant")

EDGE = 16
BATCHES = 8
SAMPLES = 512
MOST_DEVIATION = 4.0
"""Standard errors between two independent means: one pair in 16 000 is farther apart."""
SINGLE_PRECISION = 1e-5
BUSY = 5.0
"""Times of equal work may differ by so much on a machine that others use."""


@pytest.fixture(scope="module")
def box(variant: str) -> LoadedScene:
    return load_scene("cornell_box", resolution=EDGE)


def small(config: RenderConfig) -> RenderConfig:
    """Return a configuration that is quickly rendered."""
    return replace(config, clipmap=ClipmapConfig(resolution=16), samples_per_pixel=1)


def tracer_of(box: LoadedScene) -> PathTracer:
    return PathTracer(
        scene=box.scene, sensor=box.scene.sensors()[box.sensor_index], scattering_count=COUNT
    )


@pytest.fixture(scope="module")
def truth(box: LoadedScene) -> reference.Reference:
    request = reference.ReferenceRequest(
        samples_per_pixel=BATCHES * SAMPLES, batch_count=BATCHES, rest_samples_per_pixel=0
    )
    return reference.render_reference(box.scene, request=request, cache_directory=None)


def test_paths_carry_the_light_of_the_reference(
    box: LoadedScene, truth: reference.Reference
) -> None:
    tracer = tracer_of(box)
    means = [float(tracer.frame(SAMPLES, seed).image(EDGE, EDGE).mean()) for seed in range(BATCHES)]
    known = truth.batches("indirect").mean(axis=(1, 2, 3))
    spread = np.hypot(np.std(means, ddof=1), known.std(ddof=1)) / np.sqrt(BATCHES)
    assert abs(np.mean(means) - known.mean()) <= MOST_DEVIATION * spread


def test_the_error_of_paths_falls_fourfold_with_four_times_the_samples(
    box: LoadedScene, truth: reference.Reference
) -> None:
    shared = truth.mean("direct") + truth.mean("emission")
    compared = Truth.of(truth.batches("indirect"), shared)
    tracer = tracer_of(box)
    few, many = (
        score([tracer.frame(n, seed).image(EDGE, EDGE) for seed in range(5)], compared).relmse
        for n in (16, 64)
    )
    assert 2.0 < few.value / many.value < 8.0
    assert few.low is not None
    assert few.low < few.value


def test_a_denoiser_takes_noise_away(box: LoadedScene, truth: reference.Reference) -> None:
    if not has_denoiser():
        pytest.skip("the extra [denoise] is missing")
    tracer = tracer_of(box)
    known = truth.mean("indirect")
    frame = tracer.denoised(16, 0)
    errors = [
        float(np.mean((each.image(EDGE, EDGE) - known) ** 2))
        for each in (tracer.frame(16, 0), frame)
    ]
    assert errors[1] < errors[0]
    assert frame.host_seconds > 0.0


def test_a_published_scale_is_a_factor_on_the_diffuse_light(box: LoadedScene) -> None:
    name = "peer:compix"
    plain, published = (small(preset(name + end)) for end in ("", ":published"))
    scaled = next(each for each in cone_methods(quick=False) if each.name == f"{name}:published")
    assert scaled.renders_like == name
    lit = LitScene.of(box, light_key(plain))
    own = next(each for each in cone_methods(quick=False) if each.name == name)
    sensor = box.scene.sensors()[box.sensor_index]
    by_gain = indirect_image(vctgi.render_frame(lit.prepared, lit.lit.volume, plain), scaled)
    prepared = vctgi.prepare_scene(box.scene, sensor, published)
    volume = vctgi.light_volume(prepared, published).volume
    rendered = indirect_image(vctgi.render_frame(prepared, volume, published), own)
    assert by_gain == pytest.approx(rendered, rel=SINGLE_PRECISION, abs=SINGLE_PRECISION)
    assert scaled.gain > 1.0


def test_moved_windows_change_voxels_and_come_back(box: LoadedScene) -> None:
    config = small(preset("medium"))
    lit = LitScene.of(box, light_key(config))
    method = next(each for each in cone_methods(quick=False) if each.name == "medium")
    render = lit.moving_camera(config)
    moved, back, still, lit_anew = (
        indirect_image(cast(Frame, make(0)), method)
        for make in (render, render, lit.still(config), lit.moving_lights(config))
    )
    assert moved.shape == still.shape
    # An update is equal to a rebuild bit for bit, and the second step is back where it began.
    assert back == pytest.approx(still, rel=SINGLE_PRECISION, abs=SINGLE_PRECISION)
    assert lit_anew == pytest.approx(still, rel=SINGLE_PRECISION, abs=SINGLE_PRECISION)


@pytest.fixture(scope="module")
def few(box: LoadedScene) -> dict[str, Result]:
    """Return the results of a preset, a relative of it, a recipe's scale, and paths."""
    config = small(preset("medium"))
    named = [(HIGH, OURS, ""), ("other", GRID, ""), ("scaled", RECIPES, "other")]
    cones = [
        Method(name=name, family=family, config=config, samples_per_pixel=1, renders_like=like)
        for name, family, like in named
    ]
    paths = [Method(name=path_name(n), family=PATHS, samples_per_pixel=n) for n in (1, 128)]
    context = StudyContext(quick=True, progress=lambda *_: None)
    return run_methods(context, box, cones, paths).results


def test_every_method_has_times_for_every_kind_of_frame(few: dict[str, Result]) -> None:
    assert all(set(result.clocks) == set(FRAMES) for result in few.values())
    assert all(
        len(clocks.warm) == REPETITIONS and all(each.compiled == 0 for each in clocks.warm)
        for result in few.values()
        for clocks in result.clocks.values()
    )
    high, other, scaled = (few[name].clocks for name in (HIGH, "other", "scaled"))
    assert scaled == other
    for kind in (CAMERA, LIGHTS):
        # Its frames are the sum of two parts, those of the preset are timed as a whole, too.
        assert other[kind].device().value > other[STILL].device().value
        summed = few[HIGH].parts[kind]
        assert summed is not high[kind]
        assert 1.0 / BUSY < summed.device().value / high[kind].device().value < BUSY
        assert few[path_name(1)].clocks[kind] is few[path_name(1)].clocks[STILL]


def test_charts_and_table_show_every_method(few: dict[str, Result], box: LoadedScene) -> None:
    shelf = FigureShelf()
    draw(shelf, Bench(box, few, NoiseFloor(value=1e-3, upper=2e-3, samples_per_pixel=64)))
    charts = [each for each in shelf.figures if isinstance(each, ScatterFigure)]
    still, moving = (each for each in shelf.figures if isinstance(each, TableFigure))
    assert len(charts) == len(FRAMES)
    assert all({p.name for p in panel.points} == set(few) for c in charts for panel in c.panels)
    assert len(still.columns) == len(moving.columns) == 6
    for table in (still, moving):
        assert {line.name for line in table.lines} == set(few)
        assert all(cell is not None for line in table.lines for cell in line.cells)


@pytest.mark.parametrize(
    ("errors", "noises"),
    [
        # What is large enough for the first reference
        ([0.2], [1e-2]),
        # Smaller, then smaller still than the first reference could tell
        ([0.012, 0.0101], [1e-2, 1e-3]),
        # Hidden by noise
        ([-0.001, 0.02], [1e-2, 1e-3]),
    ],
)
def test_the_reference_is_refined_until_the_smallest_error_can_be_seen(
    errors: list[float], noises: list[float], box: LoadedScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    given = iter(errors)

    def rendered(_scene: object, *, target: reference.ReferenceTarget, **_: object) -> object:
        asked.append(target.relmse)
        return SimpleNamespace(mean=lambda _: 0.0, batches=lambda _: None)

    def scored(*_: object) -> object:
        return SimpleNamespace(relmse=Measured(value=next(given)))

    monkeypatch.setattr(reference, "render_to_target", rendered)
    monkeypatch.setattr(reference, "require_low_noise", lambda *_: None)
    monkeypatch.setattr(
        reference,
        "noise_floor",
        lambda *_: NoiseFloor(value=0.9 * asked[-1], upper=asked[-1], samples_per_pixel=64),
    )
    monkeypatch.setattr(Truth, "of", lambda *_: None)
    monkeypatch.setattr(bench, "score", scored)
    method = Method(name="medium", family=OURS, samples_per_pixel=1)
    context = StudyContext(quick=True, progress=lambda *_: None)
    _, noise = bench._find_truth(context, box, {"medium": [np.zeros(3)]}, {"medium": method})
    assert asked == pytest.approx(noises)
    assert noise.upper <= errors[-1] / 10.0


def test_a_shorter_frame_warms_up() -> None:
    frames: list[str] = []

    def made(name: str) -> Render:
        return lambda _seed: frames.append(name)

    job = Job("long", made("long"), warm_up=made("short"))
    time_jobs([job], np.random.default_rng(0), repetitions=3)
    assert frames == ["short"] * WARM_FRAMES + ["long"] * 3


def test_times_of_two_parts_add_up() -> None:
    first, second = (
        Clocks(c, [FrameTime(d, w, 0) for d, w in frames])
        for c, frames in ((1.0, [(1.0, 2.0), (3.0, 4.0)]), (0.5, [(0.1, 0.2), (0.3, 0.4)]))
    )
    found = first + second
    assert found.compile == 1.5
    assert [each.device for each in found.warm] == pytest.approx([1.1, 3.3])
    assert [each.wall for each in found.warm] == pytest.approx([2.2, 4.4])


def test_only_warm_frames_are_timed() -> None:
    seeds: list[int] = []

    def render(seed: int) -> mi.Float:
        seeds.append(seed)
        # New code for the first two frames, then always the same.
        value = dr.arange(mi.Float, 1 << 10) * (0.123 + 0.001 * min(seed, 1))
        dr.eval(value)
        return value

    kept: list[object] = []
    job = Job("sums", render, kept.append)
    time_jobs([job], np.random.default_rng(0), repetitions=5)
    assert len(job.clocks.warm) == len(kept) == 5
    assert len(seeds) - 5 >= WARM_FRAMES
    assert all(frame.compiled == 0 for frame in job.clocks.warm)
    assert all(0.0 < frame.device <= frame.wall for frame in job.clocks.warm)
    assert timed_frame(render, 5)[0].compiled == 0


def test_a_frame_that_always_compiles_is_refused() -> None:
    def render(seed: int) -> mi.Float:
        value = dr.arange(mi.Float, 1 << 10) * (0.77 + 0.01 * seed)
        dr.eval(value)
        return value

    dr.flush_kernel_cache()
    with pytest.raises(NeverWarmError, match="no frame of sums is warm"):
        time_jobs([Job("sums", render)], np.random.default_rng(0))


def test_all_presets_recipes_and_counts_are_compared() -> None:
    found = methods(quick=False)
    names = [each.name for each in found]
    assert len(names) == len(set(names))
    assert {each.family for each in found} == set(FAMILIES)
    assert set(PRESET_NAMES) < set(names)
    assert {path_name(1 << power) for power in range(13)} < set(names)
    assert {name for name in peer_names() if ":published" not in name} < set(names)
    for quick in (False, True):
        assert sum(each.is_on_floor for each in methods(quick=quick)) >= 4


def test_checks_name_what_they_are_of() -> None:
    found = checks()
    names = [each.name for each in found]
    assert len(names) == len(set(names))
    assert [each for each in found if each.in_quick and "cornell_box" not in each.name] == []
    slopes = [each for each in found if "slope" in each.name and each.limit_low is not None]
    assert {(each.limit_low, each.limit_high) for each in slopes} == {(-1.15, -0.85)}
    assert any(each.is_headline and HIGH in each.name for each in found)
