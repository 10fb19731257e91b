"""Channels of a picture: what its camera rays found, summed over the rays, side by side."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.maths.evaluation import evaluated
from vctgi.scene.records import GBuffer
from vctgi.stages.composite import IndirectLight


def surfaces(gbuffer: GBuffer) -> dict[str, list[mi.Float]]:
    """Return what the first ray of each pixel met."""
    normal = dr.select(gbuffer.is_valid, gbuffer.normal, 0.0)
    return {
        "position": [mi.Float(each) for each in gbuffer.position],
        "surface_normal": [mi.Float(each) for each in normal],
    }


def light_sample(gbuffer: GBuffer, light: IndirectLight) -> dict[str, list[mi.Float]]:
    """Return a sample of each pixel of a picture of light."""
    return {
        "indirect_diffuse": list(light.diffuse),
        "indirect_specular": list(light.specular),
        **_surface_sample(gbuffer),
    }


def ambient_sample(gbuffer: GBuffer, openness: mi.Color3f) -> dict[str, list[mi.Float]]:
    """Return a sample of each pixel of a picture of ambient occlusion, which has no light."""
    dark = [dr.zeros(mi.Float, dr.width(gbuffer.depth))] * 3
    return {
        "indirect_diffuse": dark,
        "indirect_specular": dark,
        **_surface_sample(gbuffer),
        "ambient": [mi.Float(dr.select(gbuffer.is_valid, openness.x, 1.0))],
    }


def _surface_sample(gbuffer: GBuffer) -> dict[str, list[mi.Float]]:
    normal = dr.select(gbuffer.is_valid, gbuffer.normal, 0.0)
    return {
        "albedo": list(gbuffer.albedo),
        "normal": [mi.Float(each) for each in normal],
        "depth": [gbuffer.depth],
    }


def accumulate(
    sums: dict[str, list[mi.Float]], sample: dict[str, list[mi.Float]], sample_count: int
) -> None:
    """Add a sample of each pixel to the picture."""
    for name, channels in sample.items():
        shares = [mi.Float(channel) / sample_count for channel in channels]
        held = sums.get(name)
        sums[name] = shares if held is None else [a + b for a, b in zip(held, shares, strict=True)]
    sums.update(evaluated(sums))


def tensors(channels: dict[str, list[mi.Float]], width: int, height: int) -> dict[str, mi.TensorXf]:
    """Return pictures, each of one or three channels side by side."""
    flats = {
        name: planes[0] if len(planes) == 1 else mi.Float(dr.ravel(mi.Color3f(*planes)))
        for name, planes in channels.items()
    }
    # All in one launch, which a tensor of its own would end.
    dr.eval(flats)
    return {
        name: mi.TensorXf(flat, (height, width, len(channels[name])))
        for name, flat in flats.items()
    }
