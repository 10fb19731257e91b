"""Kernels of derivatives: one march each, whatever the number of samples and cones."""

from __future__ import annotations

from dataclasses import replace

import drjit as dr
import mitsuba as mi
import pytest

from tests.vctgi.small_scenes import camera, diffuse, load, room
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.config import RenderConfig
from vctgi.parameters import ConeParameters
from vctgi.pipeline import light_volume, prepare_scene, render_frame
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig

pytestmark = pytest.mark.usefixtures("variant")

SAME = 1.1
"""Numbers that are baked into the kernels of the first sample save it a few operations."""


@pytest.mark.parametrize("mode", ["forward", "reverse"])
def test_more_samples_take_no_larger_kernels(mode: str) -> None:
    """A picture of four samples has a march each; they were one kernel in forward mode."""
    bulb = {"type": "point", "position": [0.3, 0.0, 0.3], "intensity": 2.0}
    eye = camera([0, 0, 0.9], [0, -0.3, 0], size=4, fov=80.0)
    scene = load(paint={**diffuse(), "id": "paint"}, **room(), bulb=bulb, eye=eye)
    one = RenderConfig(
        clipmap=ClipmapConfig(resolution=16, max_level_count=1),
        diffuse=DiffuseConesConfig(cone_count=4, near_field_voxels=0.0),
        samples_per_pixel=1,
    )
    prepared = prepare_scene(scene, scene.sensors()[0], one)
    volume = light_volume(prepared, one).volume
    largest = []
    for config in (one, replace(one, samples_per_pixel=4)):
        parameters = ConeParameters.from_config(config)
        value = parameters["aperture_scale"]
        dr.enable_grad(value)
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            frame = render_frame(prepared, volume, config, parameters=parameters)
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
