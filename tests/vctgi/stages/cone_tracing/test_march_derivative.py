"""Derivatives of the march: closed forms, differences, and a march that Dr.Jit differentiates."""

from __future__ import annotations

import gc
from dataclasses import replace

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.hand_made_volumes import (
    emittance_of,
    homogeneous_volume,
    opacity_of,
    random_values,
)
from vctgi.clipmap.gathered import GatheredTexels
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.clipmap.storage import StorageConfig, StorageFormat, VoxelVolume, pack_volume
from vctgi.maths.stub_gaps import as_component
from vctgi.stages.cone_tracing.live_march import LiveMarch
from vctgi.stages.cone_tracing.march import ConeMarchConfig, ConeSample, march_cone

pytestmark = pytest.mark.usefixtures("variant")

LAYOUT = lay_out_clipmap(
    (0.03, -0.02, 0.01), finest_voxel_size=1 / 16, level_count=2, resolution=16
)
CONES = 256
RULES = ConeMarchConfig()
NUMBERS = (
    "step_ratio",
    "min_step_voxels",
    "start_offset_voxels",
    "level_bias",
    "pull_back_voxels",
    "correction_factor",
)
AT = {
    "step_ratio": 0.43,
    "min_step_voxels": 0.29,
    "start_offset_voxels": 1.07,
    "level_bias": -1.0,
    "pull_back_voxels": 0.25,
    "correction_factor": 1.0,
    "ratio": 0.52,
    "phase": 0.7,
    "lift": 0.01,
    "tilt": 0.01,
}
"""The numbers that the cones of this module follow from. They are at no kink: where steps by two
rules are equally long for all cones at once, a derivative is that of one side."""

DIFFERENCE = 1e-3
"""Share of themselves by which numbers are moved; single precision bounds it from below."""

AGREEMENT = 0.05
"""Relative to the difference, as the issue asks; kinks at voxel centres and levels are averaged
over all cones."""

SMALL = 1.0
"""A derivative below this counts as small; the sum itself is about 100."""

TWIN = 2e-4
"""Two derivatives of one march, in single precision, over 256 cones with sums of both signs."""


def random_volume(seed: int = 1) -> VoxelVolume:
    alphas, colors = random_values(LAYOUT, seed, empty_share=0.9)
    # Thin enough that much of a cone is seen
    return pack_volume(
        opacity_of(LAYOUT, [0.3 * a for a in alphas]),
        emittance_of(LAYOUT, [0.3 * c for c in colors]),
    )


def smooth_volume() -> VoxelVolume:
    """Opacity and emittance that change slowly, so that no kink between voxels counts much."""
    alphas, colors = [], []
    for level in LAYOUT.levels:
        place = (np.arange(level.resolution) + 0.5 + level.origin[0]) * level.voxel_size
        z, y, x = np.meshgrid(place, place, place, indexing="ij")
        density = 0.6 + 0.4 * np.sin(2.0 * x + 0.3) * np.cos(1.5 * y) * np.cos(2.5 * z + 0.5)
        alpha = -np.expm1(-density * level.voxel_size)
        alphas.append(np.stack([alpha] * 6))
        glow = 1.0 + 0.5 * np.cos(1.7 * x + 0.2) * np.sin(2.2 * y + z)
        colors.append(np.stack([(alpha * glow)[..., None] * [1.0, 0.8, 0.6]] * 6))
    return pack_volume(opacity_of(LAYOUT, alphas), emittance_of(LAYOUT, colors))


def directions(count: int = CONES) -> np.ndarray:
    rng = np.random.default_rng(3)
    d = rng.normal(size=(3, count))
    unit: np.ndarray = d / np.linalg.norm(d, axis=0)
    return unit


def cone_sample(
    volume: VoxelVolume, numbers: dict[str, mi.Float], rules: ConeMarchConfig = RULES
) -> ConeSample:
    """Cones from all around the middle, at the numbers that are given."""
    at = {name: numbers.get(name, mi.Float(value)) for name, value in AT.items()}
    d = mi.Vector3f(directions())
    side = dr.normalize(dr.cross(d, mi.Vector3f(0.3, 0.5, -0.8)))
    sine, cosine = (as_component(each) for each in dr.sincos(at["tilt"]))
    axis = mi.Vector3f(cosine * d + sine * side)
    lift = as_component(at["lift"])
    apex = mi.Point3f(0.02 + 0.4 * lift, 0.03 + 0.3 * lift, 0.04 + 0.5 * lift)
    # Cones that all step alike have their kinks at the same places (accuracy: ripples)
    phase = at["phase"] * mi.Float(np.random.default_rng(4).uniform(0.3, 1.3, CONES))
    march = LiveMarch(rules, **{name: at[name] for name in NUMBERS})
    return march_cone(volume, apex, axis, at["ratio"], phase, march, mi.Bool(True))


def total(sample: ConeSample) -> mi.Float:
    """Sum in which neither the channels nor the cones are alike."""
    weight = 1.0 + 0.5 * dr.sin(mi.Float(dr.arange(mi.UInt32, CONES)))
    x, y, z = sample.radiance
    return mi.Float(dr.sum(weight * (x + 0.5 * y + 0.25 * z - 0.3 * sample.transmittance)))


def in_double(sample: ConeSample) -> float:
    weight = 1.0 + 0.5 * np.sin(np.arange(CONES))
    x, y, z = np.array(sample.radiance, dtype=np.float64)
    t = np.array(sample.transmittance, dtype=np.float64)
    return float(np.sum(weight * (x + 0.5 * y + 0.25 * z - 0.3 * t)))


def derivative(volume: VoxelVolume, name: str, mode: str, rules: ConeMarchConfig = RULES) -> float:
    value = mi.Float(AT[name])
    dr.make_opaque(value)
    dr.enable_grad(value)
    found = total(cone_sample(volume, {name: value}, rules))
    if mode == "forward":
        dr.forward(value)
        return float(found.grad[0])
    dr.backward(found)
    return float(value.grad[0])


def central_difference(volume: VoxelVolume, name: str, rules: ConeMarchConfig = RULES) -> float:
    step = DIFFERENCE * max(abs(AT[name]), 0.5)
    ends = [
        in_double(cone_sample(volume, {name: mi.Float(AT[name] + s * step)}, rules))
        for s in (1.0, -1.0)
    ]
    return (ends[0] - ends[1]) / (2.0 * step)


FAST = ("step_ratio", "ratio", "phase", "correction_factor")
"""Numbers that every test run looks at; the others' kernels take as long to compile again."""


@pytest.mark.parametrize(
    "name",
    [name if name in FAST else pytest.param(name, marks=pytest.mark.slow) for name in AT],
)
def test_both_modes_are_the_central_difference(name: str) -> None:
    volume = smooth_volume()
    wanted = central_difference(volume, name)
    forward, backward = (derivative(volume, name, mode) for mode in ("forward", "backward"))
    scale = max(abs(wanted), SMALL)
    assert forward == pytest.approx(wanted, abs=AGREEMENT * scale)
    assert backward == pytest.approx(forward, abs=TWIN * scale)


@pytest.mark.parametrize("name", ["ratio", "tilt"])
def test_the_replay_is_what_the_loop_itself_differentiates_to(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Dr.Jit's own forward mode follows every step; its state has its full width here."""
    volume = random_volume()
    found = derivative(volume, name, "backward")
    monkeypatch.setattr("vctgi.stages.cone_tracing.march.has_derivatives", lambda *_: False)
    assert found == pytest.approx(derivative(volume, name, "forward"), rel=TWIN, abs=TWIN * SMALL)


def test_fog_lets_through_what_the_exponential_says() -> None:
    """Along an axis through fog of extinction k, T = exp(-k s f) and L = R (1 - T)."""
    extinction, radiance, length = 0.8, 2.0, 0.5
    volume = homogeneous_volume(LAYOUT, extinction, radiance)
    factor = mi.Float(1.3)
    dr.enable_grad(factor)
    march = replace(RULES, max_distance_voxels=length / LAYOUT.finest_voxel_size)
    live = replace(LiveMarch.of_numbers(march, None), correction_factor=factor)
    axis = mi.Vector3f(1.0, 0.0, 0.0)
    apex, phase, ratio = mi.Point3f(0.03, 0.04, 0.05), mi.Float(0.6), mi.Float(0.1)
    cone = march_cone(volume, apex, axis, ratio, phase, live, mi.Bool(True))
    through = 1.3 * extinction * (length - LAYOUT.finest_voxel_size)
    slope = -through / 1.3 * np.exp(-through)
    dr.forward(factor, flags=dr.ADFlag.ClearInterior)
    # Opacity becomes depth again in single precision
    assert float(cone.transmittance.grad[0]) == pytest.approx(slope, rel=1e-4)
    assert float(cone.radiance.grad.x[0]) == pytest.approx(-radiance * slope, rel=1e-4)
    dr.set_grad(factor, 0.0)
    dr.backward(cone.radiance.x)
    assert float(factor.grad[0]) == pytest.approx(-radiance * slope, rel=1e-4)


def words_of(volume: VoxelVolume) -> tuple[VoxelVolume, mi.Float]:
    texels = volume.texels
    assert isinstance(texels, GatheredTexels)
    words = mi.Float(texels.words)
    dr.enable_grad(words)
    return replace(volume, texels=replace(texels, words=words)), words


@pytest.mark.parametrize("mode", ["forward", "backward"])
def test_voxels_have_the_derivatives_of_differences(mode: str) -> None:
    """Along a change of all voxels at once, of emittance and opacity alike."""
    volume = random_volume()
    rng = np.random.default_rng(5)
    live, words = words_of(volume)
    held = np.array(words, dtype=np.float64)
    way = np.where(held > 0.0, rng.uniform(-1.0, 1.0, held.shape) * held, 0.0)

    def at(share: float) -> float:
        texels = replace(volume.texels, words=mi.Float(np.float32(held + share * way)))  # type: ignore[type-var]
        return in_double(cone_sample(replace(volume, texels=texels), {}))

    wanted = (at(1e-2) - at(-1e-2)) / 2e-2
    if mode == "forward":
        dr.set_grad(words, mi.Float(np.float32(way)))
        result = total(cone_sample(live, {}))
        dr.forward_to(result)
        found = float(result.grad[0])
    else:
        dr.backward(total(cone_sample(live, {})))
        found = float(np.sum(np.array(words.grad, dtype=np.float64) * way))
    assert found == pytest.approx(wanted, rel=1e-3)


def test_reverse_mode_needs_no_memory_of_the_steps() -> None:
    """Ten times the steps need the same memory, whichever number is differentiated by."""
    volume = random_volume()
    peaks = []
    for shortest in (0.3, 0.03):
        rules = replace(RULES, step_ratio=0.1 * shortest)
        ratio, small = dr.opaque(mi.Float, 0.5), dr.opaque(mi.Float, shortest)
        dr.enable_grad(ratio)
        numbers = {"ratio": ratio, "min_step_voxels": small}
        numbers["step_ratio"] = dr.opaque(mi.Float, 0.1 * shortest)
        found = cone_sample(volume, numbers, rules)
        steps = int(np.array(found.step_count).max())
        dr.eval(found)
        gc.collect()
        dr.flush_malloc_cache()
        dr.detail.malloc_clear_statistics()
        dr.backward(total(found))
        dr.eval(ratio.grad)
        dr.sync_thread()
        peaks.append((steps, dr.detail.malloc_watermark(dr.backend_v(mi.Float))))
    assert peaks[1][0] > 5 * peaks[0][0]
    assert peaks[1][1] <= peaks[0][1]


@pytest.mark.parametrize("opacity", [1e-20, 1.0])
def test_derivatives_stay_finite(opacity: float) -> None:
    """For rays and half spaces, through nothing, hardly anything and walls, dark and bright."""
    shapes = [(6,) + (level.resolution,) * 3 for level in LAYOUT.levels]
    alphas = [np.full(shape, opacity) for shape in shapes]
    for emittance in (1e-8, 1e8):
        colors = [np.repeat(emittance * a[..., None], 3, axis=-1) for a in alphas]
        volume = pack_volume(opacity_of(LAYOUT, alphas), emittance_of(LAYOUT, colors))
        volume, words = words_of(volume)
        for ratio in (0.0, 1e-6, 1e4):
            values = {name: dr.opaque(mi.Float, AT[name]) for name in AT}
            values["ratio"] = dr.opaque(mi.Float, ratio)
            dr.enable_grad(values)
            dr.backward(total(cone_sample(volume, values)))
            for name, value in values.items():
                assert np.isfinite(np.array(value.grad)).all(), (name, ratio)
            assert np.isfinite(np.array(words.grad)).all(), ratio


@pytest.mark.parametrize("name", ["float16", "rgba8", "rgb10a2", "texture16"])
def test_voxels_are_not_cut_by_their_format(name: StorageFormat) -> None:
    alphas, colors = random_values(LAYOUT, 1)
    emittance = emittance_of(LAYOUT, colors)
    dr.enable_grad(emittance.levels[0])
    with pytest.raises(ValueError, match="has no derivatives, and the voxels have"):
        pack_volume(opacity_of(LAYOUT, alphas), emittance, StorageConfig(format=name))


def test_formats_without_derivatives_are_refused() -> None:
    alphas, colors = random_values(LAYOUT, 1)
    half = StorageConfig(format="float16")
    volume = pack_volume(opacity_of(LAYOUT, alphas), emittance_of(LAYOUT, colors), half)
    dr.enable_grad(volume.texels.words)  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match='only voxels of the format "float32"'):
        cone_sample(volume, {})
