"""Boundaries between stages: values and derivatives pass unchanged, kernels do not grow."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from vctgi.maths.evaluation import evaluated, with_boundary

pytestmark = pytest.mark.usefixtures("variant")

LANES = 5


@dataclass
class Found:
    """Arrays of every kind, with and without derivatives."""

    place: mi.Point3f
    number: mi.UInt32
    parts: list[mi.Float]
    plane: mi.TensorXf
    nothing: mi.Float | None = None


@contextmanager
def history() -> Iterator[list[dict[str, Any]]]:
    """Give the kernels that run inside."""
    kernels: list[dict[str, Any]] = []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        yield kernels
        kernels += dr.kernel_history((dr.KernelType.JIT,))


def found_at(x: mi.Float) -> Found:
    steady = dr.arange(mi.Float, LANES)
    return Found(
        place=mi.Point3f(x, steady, 2.0 * x),
        number=dr.arange(mi.UInt32, LANES),
        parts=[mi.Float(dr.square(x)), steady + 1.0],
        plane=mi.TensorXf(mi.Float(3.0 * x), (LANES, 1)),
    )


def total(found: Found) -> mi.Float:
    places = found.place.x * found.place.y + found.place.z
    return mi.Float(places + found.parts[0] * found.parts[1] + found.plane.array)


def wanted(x: np.ndarray) -> np.ndarray:
    """Return the derivative of `total`: x i + 2 x + x^2 (i + 1) + 3 x."""
    lane = np.arange(LANES)
    slope: np.ndarray = lane + 2.0 + 2.0 * x * (lane + 1.0) + 3.0
    return slope


@pytest.mark.parametrize("boundary", [evaluated, with_boundary])
def test_values_and_derivatives_pass_unchanged(boundary: Any) -> None:
    x = dr.linspace(mi.Float, 0.5, 2.0, LANES)
    dr.enable_grad(x)
    given = found_at(x)
    passed = boundary(given)
    assert isinstance(passed, Found)
    np.testing.assert_array_equal(np.array(total(passed)), np.array(total(given)))
    assert tuple(passed.plane.shape) == (LANES, 1)
    assert passed.number is given.number
    # What had no derivatives has none behind the boundary, either.
    assert not dr.grad_enabled(passed.place.y)
    assert not dr.grad_enabled(passed.parts[1])

    slope = wanted(np.array(x, dtype=np.float64))
    dr.backward(total(passed))
    np.testing.assert_allclose(np.array(dr.grad(x)), slope, rtol=1e-6)

    y = dr.linspace(mi.Float, 0.5, 2.0, LANES)
    dr.enable_grad(y)
    dr.set_grad(y, 1.0)
    forward = dr.forward_to(total(boundary(found_at(y))))
    np.testing.assert_allclose(np.array(forward), slope, rtol=1e-6)


def test_what_has_no_derivatives_is_handed_back() -> None:
    given = found_at(dr.linspace(mi.Float, 0.5, 2.0, LANES))
    assert evaluated(given) is given


@pytest.mark.parametrize("mode", ["forward", "reverse"])
def test_kernels_of_derivatives_do_not_grow_with_the_number_of_stages(mode: str) -> None:
    """Ten stages take kernels no larger than three do: without boundaries they would be one."""
    largest = []
    for count in (3, 10):
        x = dr.opaque(mi.Float, 0.5, LANES)
        dr.enable_grad(x)
        with history() as kernels:
            value = mi.Float(x)
            for _ in range(count):
                for _ in range(8):
                    value = mi.Float(dr.sin(value))
                value = evaluated(value)
            if mode == "forward":
                dr.set_grad(x, 1.0)
                dr.eval(dr.forward_to(value))
            else:
                dr.backward(value)
                dr.eval(dr.grad(x))
        largest.append(max(kernel["operation_count"] for kernel in kernels))
    assert largest[1] <= largest[0]
