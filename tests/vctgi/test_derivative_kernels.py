"""Kernels and memory of derivatives: one march each, whatever the number of samples and cones."""

from __future__ import annotations

import gc
from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import pytest

from tests.vctgi.small_scenes import camera, diffuse, load, room
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.config import RenderConfig
from vctgi.parameters import ConeParameters
from vctgi.pipeline import PreparedScene, light_volume, prepare_scene, render_frame
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig

pytestmark = pytest.mark.usefixtures("variant")

SAME = 1.1
"""Numbers that are baked into the kernels of the first sample save it a few operations, and every
sample keeps the arrays of a few dozen cones."""

ONE = RenderConfig(
    clipmap=ClipmapConfig(resolution=32, max_level_count=1),
    diffuse=DiffuseConesConfig(cone_count=4, near_field_voxels=0.0),
    samples_per_pixel=1,
)


@pytest.fixture
def lit() -> tuple[PreparedScene, Any]:
    bulb = {"type": "point", "position": [0.3, 0.0, 0.3], "intensity": 2.0}
    eye = camera([0, 0, 0.9], [0, -0.3, 0], size=4, fov=80.0)
    scene = load(paint={**diffuse(), "id": "paint"}, **room(), bulb=bulb, eye=eye)
    prepared = prepare_scene(scene, scene.sensors()[0], ONE)
    return prepared, light_volume(prepared, ONE).volume


@pytest.mark.parametrize("mode", ["forward", "reverse"])
def test_more_samples_take_no_larger_kernels(lit: tuple[PreparedScene, Any], mode: str) -> None:
    """A picture of four samples has a march each; they were one kernel in forward mode."""
    largest = []
    for config in (ONE, replace(ONE, samples_per_pixel=4)):
        parameters = ConeParameters.from_config(config)
        value = parameters["aperture_scale"]
        dr.enable_grad(value)
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            frame = render_frame(*lit, config, parameters=parameters)
            numbers = mi.Float(frame.indirect_diffuse.array)
            if mode == "forward":
                dr.set_grad(value, 1.0)
                dr.eval(dr.forward_to(numbers))
            else:
                dr.backward(numbers)
                dr.eval(dr.grad(value))
            kernels = dr.kernel_history((dr.KernelType.JIT,))
        largest.append(max(kernel["operation_count"] for kernel in kernels))
    assert largest[1] <= SAME * largest[0]


def test_more_samples_keep_no_more_derivatives_of_voxels(lit: tuple[PreparedScene, Any]) -> None:
    """Each march has derivatives by all voxels, which are added up as they come."""
    prepared, volume = lit
    peaks = []
    for count in (3, 8):
        words = mi.Float(volume.texels.words)
        dr.enable_grad(words)
        held = replace(volume, texels=replace(volume.texels, words=words))
        gc.collect()
        dr.flush_malloc_cache()
        dr.detail.malloc_clear_statistics()
        frame = render_frame(prepared, held, replace(ONE, samples_per_pixel=count))
        dr.backward(frame.indirect_diffuse.array)
        dr.eval(dr.grad(words))
        dr.sync_thread()
        peaks.append(dr.detail.malloc_watermark(dr.backend_v(mi.Float)))
    assert peaks[1] <= SAME * peaks[0]
