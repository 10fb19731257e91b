"""What forward mode needs: a BSDF behind all others while derivatives are asked for, and means."""

from __future__ import annotations

import gc

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import diffuse, load
from vctgi.scene.forward_mode import last_bsdf, ready_for_forward_mode, texture_means

pytestmark = pytest.mark.usefixtures("variant")


def registered() -> int:
    """Count the BSDFs that calls trace."""
    one: mi.BSDF = mi.load_dict(diffuse())
    traced = []

    def note(bsdf: mi.BSDF) -> mi.Float:
        traced.append(bsdf)
        return mi.Float(0.0)

    dr.dispatch(mi.BSDFPtr(one), note)
    return len(traced)


def test_it_is_behind_bsdfs_that_came_later_and_in_gaps() -> None:
    held = [mi.load_dict(diffuse()) for _ in range(3)]
    first = last_bsdf()
    assert first.is_last()
    assert last_bsdf() is first
    held += [mi.load_dict(diffuse())]
    assert not first.is_last()
    # Places in the registry that are free now are taken first
    del held[:2]
    gc.collect()
    assert last_bsdf().is_last()


def test_it_lives_as_long_as_derivatives_may_be_asked_for() -> None:
    gc.collect()
    before = registered()
    scene = load(s={"type": "rectangle", "bsdf": diffuse()})
    gc.collect()
    with_scene = registered()
    x = dr.opaque(mi.Float, 2.0)
    dr.enable_grad(x)
    found = ready_for_forward_mode(scene, mi.Float(dr.square(x)))
    assert registered() == with_scene + 1
    dr.set_grad(x, 1.0)
    assert dr.forward_to(found)[0] == 4.0
    del found
    gc.collect()
    assert registered() == with_scene
    del scene
    gc.collect()
    assert registered() == before


def test_what_has_no_derivatives_is_left_alone() -> None:
    scene = load(s={"type": "rectangle", "bsdf": diffuse()})
    before = registered()
    value = mi.Float(1.0)
    assert ready_for_forward_mode(scene, value) is value
    assert registered() == before


def test_means_of_bitmaps_with_derivatives_lie_on_the_way() -> None:
    """Of two bitmaps, the one that has derivatives."""
    numbers = mi.TensorXf(np.full((2, 2, 1), 0.5, dtype=np.float32))
    painted = {
        "type": "diffuse",
        "reflectance": {"type": "bitmap", "data": numbers, "raw": True},
    }
    scene = load(a={"type": "sphere", "bsdf": painted}, b={"type": "disk", "bsdf": painted})
    assert texture_means(scene) == []
    parameters = mi.traverse(scene)
    name = "a.bsdf.reflectance.data"
    data = mi.TensorXf(parameters[name])
    dr.enable_grad(data)
    parameters[name] = data
    parameters.update()
    (mean,) = texture_means(scene)
    assert dr.grad_enabled(mean)
    assert dr.detach(mean)[0] == pytest.approx(0.5)

    x = dr.opaque(mi.Float, 3.0)
    dr.enable_grad(x)
    found = ready_for_forward_mode(scene, mi.Float(dr.square(x)))
    dr.backward(found)
    assert dr.grad(x)[0] == 6.0
    assert not np.array(dr.grad(data)).any()
