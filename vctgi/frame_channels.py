"""Channels of a picture: what its camera rays found, summed over the rays, side by side."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.maths.evaluation import with_boundary
from vctgi.scene.records import GBuffer
from vctgi.stages.composite import IndirectLight

Channels = dict[str, list["mi.Float"]]
"""Parts of a picture by name, each with its channels."""


def surfaces(gbuffer: GBuffer) -> Channels:
    """Return what the first ray of each pixel met."""
    normal = dr.select(gbuffer.is_valid, gbuffer.normal, 0.0)
    return {
        "position": [mi.Float(each) for each in gbuffer.position],
        "surface_normal": [mi.Float(each) for each in normal],
    }


def light_sample(gbuffer: GBuffer, light: IndirectLight) -> Channels:
    """Return a sample of each pixel of a picture of light."""
    return {
        "indirect_diffuse": list(light.diffuse),
        "indirect_specular": list(light.specular),
        **_surface_sample(gbuffer),
    }


def ambient_sample(gbuffer: GBuffer, openness: mi.Color3f) -> Channels:
    """Return a sample of each pixel of a picture of ambient occlusion, which has no light."""
    dark = [dr.zeros(mi.Float, dr.width(gbuffer.depth))] * 3
    return {
        "indirect_diffuse": dark,
        "indirect_specular": dark,
        **_surface_sample(gbuffer),
        "ambient": [mi.Float(dr.select(gbuffer.is_valid, openness.x, 1.0))],
    }


def _surface_sample(gbuffer: GBuffer) -> Channels:
    normal = dr.select(gbuffer.is_valid, gbuffer.normal, 0.0)
    return {
        "albedo": list(gbuffer.albedo),
        "normal": [mi.Float(each) for each in normal],
        "depth": [gbuffer.depth],
    }


def accumulate(sums: Channels, sample: Channels, sample_count: int) -> Channels:
    """Return the picture with a sample of each pixel added, not evaluated."""
    added = dict(sums)
    for name, channels in sample.items():
        shares = [mi.Float(channel) / sample_count for channel in channels]
        held = sums.get(name)
        added[name] = shares if held is None else [a + b for a, b in zip(held, shares, strict=True)]
    return added


def interleaved(channels: Channels) -> dict[str, mi.Float]:
    """Return pictures with the channels of each pixel side by side."""
    channels = with_boundary(channels)
    flats = {
        name: planes[0] if len(planes) == 1 else mi.Float(dr.ravel(mi.Color3f(*planes)))
        for name, planes in channels.items()
    }
    # All in one launch, which a tensor of its own would end.
    dr.eval(flats)
    return flats


def tensors(flats: dict[str, mi.Float], width: int, height: int) -> dict[str, mi.TensorXf]:
    """Return pictures, each of one or three channels."""
    return {
        name: mi.TensorXf(flat, (height, width, dr.width(flat) // (width * height)))
        for name, flat in flats.items()
    }
