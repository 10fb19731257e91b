"""Traps of Dr.Jit's loops and kernels that make derivatives silently wrong, or runs slow."""

from __future__ import annotations

import ast
import gc
from dataclasses import replace
from pathlib import Path

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.hand_made_volumes import homogeneous_volume
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.stages.cone_tracing.live_march import LiveMarch
from vctgi.stages.cone_tracing.march import ConeMarchConfig, march_cone

pytestmark = pytest.mark.usefixtures("variant")

LAYOUT = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=1 / 16, level_count=1, resolution=16)
EXTINCTION, RADIANCE = 0.8, 2.0
LANES = 64

TWIN = 1e-4
"""Two sums of the same march in single precision, relative."""

VCTGI = Path(__file__).parents[4] / "vctgi"

SUMS = ("stages/gbuffer.py", "stages/reconstruction/denoising.py")
"""Loops of independent terms, the only ones that `max_iterations=-1` is right for."""


def through_fog(factor: mi.Float, shortest: float = 0.2, *, is_one_lane: bool = True) -> mi.Float:
    """Return what cones of all directions let through; their numbers have one lane, or all."""
    full = 0.0 if is_one_lane else dr.zeros(mi.Float, LANES)
    rules = ConeMarchConfig(min_transmittance=0.0)
    live = replace(
        LiveMarch.of_numbers(rules, None),
        correction_factor=factor + full,
        step_ratio=dr.opaque(mi.Float, 1e-6) + full,
        min_step_voxels=dr.opaque(mi.Float, shortest) + full,
    )
    angle = mi.Float(np.linspace(0.1, 1.4, LANES))
    axis = mi.Vector3f(dr.cos(angle), dr.sin(angle), 0.0)
    apex = mi.Point3f(0.03 + full, 0.04 + full, 0.05 + full)
    volume = homogeneous_volume(LAYOUT, EXTINCTION, RADIANCE)
    ratio, phase = dr.opaque(mi.Float, 0.1) + full, dr.opaque(mi.Float, 0.6) + full
    return march_cone(volume, apex, axis, ratio, phase, live, mi.Bool(True)).transmittance


def through_fog_of_one_axis(factor: mi.Float) -> mi.Float:
    """Return what cones let through that differ in their width alone."""
    live = LiveMarch.of_numbers(ConeMarchConfig(min_transmittance=0.0), None)
    live = replace(live, correction_factor=factor)
    volume = homogeneous_volume(LAYOUT, EXTINCTION, RADIANCE)
    apex, axis = mi.Point3f(0.03, 0.04, 0.05), mi.Vector3f(1.0, 0.0, 0.0)
    dr.make_opaque(apex, axis)
    ratio, phase = mi.Float(np.linspace(0.01, 1.5, LANES)), dr.opaque(mi.Float, 0.6)
    return march_cone(volume, apex, axis, ratio, phase, live, mi.Bool(True)).transmittance


@pytest.mark.parametrize("mode", ["forward", "backward"])
def test_a_loop_that_only_widths_make_wide_has_the_derivative_of_each(mode: str) -> None:
    factor = dr.opaque(mi.Float, 1.2)
    through = np.array(through_fog_of_one_axis(factor), dtype=np.float64)
    assert through.size == LANES
    dr.enable_grad(factor)
    found = dr.sum(through_fog_of_one_axis(factor))
    if mode == "forward":
        dr.forward(factor)
        slope = float(dr.grad(found)[0])
    else:
        dr.backward(found)
        slope = float(dr.grad(factor)[0])
    assert slope == pytest.approx(float(np.sum(through * np.log(through) / 1.2)), rel=TWIN)


def test_a_state_of_full_width_has_the_derivative_that_one_of_one_lane_has_not() -> None:
    """The trap itself, three times y += t x and t += a: dy / da = 3 x, a lane each."""

    def slope(width: int) -> np.ndarray:
        a, x = dr.opaque(mi.Float, 0.5), dr.full(mi.Float, 1.0, LANES)
        dr.make_opaque(x)
        dr.enable_grad(a)
        start = dr.full(mi.Float, 0.1, width)
        dr.make_opaque(start)
        _, _, y = dr.while_loop(
            state=(dr.zeros(mi.UInt32, width), start, dr.zeros(mi.Float, width)),
            cond=lambda i, t, y: i < 3,
            body=lambda i, t, y: (i + 1, t + a, y + t * x),
        )
        dr.forward(a)
        return np.array(dr.grad(y))

    np.testing.assert_allclose(slope(LANES), 3.0, rtol=1e-6)
    # A Dr.Jit in which this is 3, too, has no such trap any more
    assert not np.allclose(slope(1), 3.0)


def slopes(mode: str, shortest: float = 0.2, *, is_one_lane: bool = True) -> float:
    """Return the derivative of the sum over all cones by the exponent, at 1.2."""
    factor = dr.opaque(mi.Float, 1.2)
    dr.enable_grad(factor)
    found = dr.sum(through_fog(factor, shortest, is_one_lane=is_one_lane))
    if mode == "forward":
        dr.forward(factor)
        return float(dr.grad(found)[0])
    dr.backward(found)
    return float(dr.grad(factor)[0])


def closed_form(shortest: float = 0.2) -> float:
    """T = exp(-k d), so that dT/dk = T ln T / k."""
    through = np.array(through_fog(dr.opaque(mi.Float, 1.2), shortest), dtype=np.float64)
    assert 0.0 < through.min() < through.max() < 1.0
    return float(np.sum(through * np.log(through) / 1.2))


@pytest.mark.parametrize("mode", ["forward", "backward"])
@pytest.mark.parametrize("is_one_lane", [True, False])
def test_numbers_of_one_lane_have_the_derivative_of_all(mode: str, is_one_lane: bool) -> None:
    """Dr.Jit's own loop adds the tangents of all lanes to each where its state has one lane."""
    assert slopes(mode, is_one_lane=is_one_lane) == pytest.approx(closed_form(), rel=TWIN)


@pytest.mark.parametrize("mode", ["forward", "backward"])
def test_a_march_of_thousands_of_steps_has_the_derivative_of_a_short_one(mode: str) -> None:
    """With `max_iterations` too small for its steps, a loop's reverse mode is silently wrong."""
    shortest = 0.005
    assert slopes(mode, shortest) == pytest.approx(closed_form(shortest), rel=10 * TWIN)


def kernels_of_gradient(value: float) -> list[str]:
    factor = dr.opaque(mi.Float, value)
    dr.enable_grad(factor)
    gc.collect()
    dr.kernel_history_clear()
    dr.backward(dr.sum(through_fog(factor)))
    dr.eval(dr.grad(factor))
    return sorted(str(entry["hash"]) for entry in dr.kernel_history() if "hash" in entry)


def test_other_values_need_no_other_kernels() -> None:
    """A number that is baked into its kernel is compiled anew at every step of an optimiser."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        first, second = (kernels_of_gradient(value) for value in (1.2, 1.3))
    assert first
    assert second == first


def loops() -> list[tuple[str, ast.Call]]:
    """All loops of the renderer, with their files."""
    return [
        (path.relative_to(VCTGI).as_posix(), node)
        for path in sorted(VCTGI.rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "dr.while_loop"
    ]


def test_no_loop_bounds_its_steps_and_only_sums_go_without_memory() -> None:
    """-1 is right for sums of independent terms alone, and no number is right for a march."""
    bounds = {
        file: ast.unparse(keyword.value)
        for file, loop in loops()
        for keyword in loop.keywords
        if keyword.arg == "max_iterations"
    }
    assert bounds == dict.fromkeys(SUMS, "-1")


def test_no_loop_starts_from_a_number_or_carries_a_ray() -> None:
    """`mi.Float(0)` is one lane wide, and so are the time and the range of `mi.Ray3f`."""
    found = loops()
    assert found
    for file, loop in found:
        (state,) = (keyword.value for keyword in loop.keywords if keyword.arg == "state")
        assert "Ray" not in ast.unparse(state), file
        assert isinstance(state, ast.Tuple), file
        for each in state.elts:
            is_literal = isinstance(each, ast.Constant) or (
                isinstance(each, ast.Call)
                and bool(each.args)
                and all(isinstance(argument, ast.Constant) for argument in each.args)
            )
            assert not is_literal, f"{file}: {ast.unparse(each)}"
