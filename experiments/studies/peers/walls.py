"""An opaque wall of radiance 1, one voxel thick: what a cone gains of it and lets through.

The wall stands across the cone's axis, 6 to 60 voxels away, in our voxels and mips; the figures of
the survey, from one-dimensional models of each system's own, stand beside as goals.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.check import Check, Measured, StudyContext, mean_of
from vctgi.clipmap.addressing import texel_from_voxel
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, VoxelVolume, pack_volume
from vctgi.clipmap.texel_choice import random_choice
from vctgi.config import PRESETS
from vctgi.maths.cones import ratio_from_aperture
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.peers import PEERS
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig
from vctgi.stages.cone_tracing.march import march_cone
from vctgi.stages.downsampling import DEFAULT_DOWNSAMPLING, DownsamplingConfig, downsample

RESOLUTION = 128
"""Voxels along the window: six levels, as many as the systems with the most of them have."""

DISTANCES = (6.0, 60.0)
"""Nearest and farthest apex, voxels."""

DISTANCE_COUNT = 512

WALL_LAYERS = ((3, 10), (3,))
"""Layers of voxels that walls stand in, one after the other, for the whole study and the quick one:
odd and even ones, not at the edges of coarse voxels, which would favour them."""

KNOWN = {
    # gain and leak, from the survey's models.
    "compix": (0.59, 0.22),
    "wicked_before": (0.92, 0.08),
    "wicked": (0.92, 0.08),
    "godot_hq": (0.32, 0.92),
    "ogre_iso": (0.09, 0.90),
    "ogre": (0.98, 0.00),
    "vctrenderer": (0.87, 0.13),
    "threejs": (0.88, 0.12),
    "hanetaka8": (0.69, 0.13),
    "cigg": (0.09, 0.91),
}
"""Gain and leak without a final scale."""

OURS_LEAK, OURS_GAIN = 0.02, (0.98, 1.001)
"""What our own march may let through, and gain."""

OURS = ("medium", "high", "ultra")


def checks() -> list[Check]:
    """Return the checks on walls."""
    found = []
    for name in [*OURS, *PEERS]:
        is_ours = name in OURS
        gain, leak = (1.0, 0.0) if is_ours else KNOWN.get(name, (None, None))
        configuration = "ours" if is_ours else PEERS[name].title
        limits = OURS_GAIN if is_ours else (None, None)
        scene = "opaque wall of radiance 1, one voxel thick, 6 to 60 voxels away"
        found.append(
            Check(
                name=f"wall, {name}, gain",
                configuration=configuration,
                scene=scene,
                measure=partial(_gain, name=name),
                limit_low=limits[0],
                limit_high=limits[1],
                goal=gain,
            )
        )
        found.append(
            Check(
                name=f"wall, {name}, leak",
                configuration=configuration,
                scene=scene,
                measure=partial(_leak, name=name),
                limit_high=OURS_LEAK if is_ours else None,
                goal=leak,
            )
        )
    return found


@dataclass(frozen=True)
class Passage:
    """Mean radiance seen and share let through, for each wall."""

    gains: list[float]
    leaks: list[float]


def _gain(context: StudyContext, name: str) -> Measured:
    return mean_of(passage(context, name).gains)


def _leak(context: StudyContext, name: str) -> Measured:
    return mean_of(passage(context, name).leaks)


def recipe(name: str) -> tuple[DiffuseConesConfig, DownsamplingConfig]:
    """Return cones and mips of one of our presets or of a peer."""
    if name in PEERS:
        return PEERS[name].diffuse, PEERS[name].downsampling
    return PRESETS[name].diffuse, DEFAULT_DOWNSAMPLING


def passage(context: StudyContext, name: str) -> Passage:
    """Return what a recipe sees of the wall, found once."""

    def cross() -> Passage:
        context.progress(f"wall, {name}", 0.0)
        diffuse, mips = recipe(name)
        pairs = [
            _cross(_walled(context, mips, layer), layer, diffuse)
            for layer in WALL_LAYERS[context.quick]
        ]
        return Passage([gain for gain, _ in pairs], [leak for _, leak in pairs])

    return context.once(f"wall, {name}", cross)


def _walled(context: StudyContext, mips: DownsamplingConfig, layer: int) -> VoxelVolume:
    """Return the wall with these mips, made once."""
    return context.once(f"wall in layer {layer}, {mips}", partial(wall_volume, mips, layer))


def wall_volume(mips: DownsamplingConfig, layer: int) -> VoxelVolume:
    """Return a wall across x that stops light from both sides and glows with radiance 1."""
    layout = _layout()
    alphas = [dr.zeros(mi.Float, DIRECTION_COUNT * level.voxel_count) for level in layout.levels]
    across = dr.arange(mi.UInt32, RESOLUTION * RESOLUTION)
    half = RESOLUTION // 2
    voxel = mi.Vector3i(
        layer, mi.Int32(across % RESOLUTION) - half, mi.Int32(across // RESOLUTION) - half
    )
    texel = texel_from_voxel(voxel, RESOLUTION)
    for side in range(2):
        dr.scatter(alphas[0], mi.Float(1.0), texel + side * layout.levels[0].voxel_count)
    light = EmittanceClipmap(layout, [mi.Color3f(a, a, a) for a in alphas], [0.0])
    opacity, emittance = downsample(OpacityClipmap(layout, alphas), light, mips)
    assert emittance is not None, "downsampling keeps the emittance it is given"
    return pack_volume(opacity, emittance)


def _layout() -> ClipmapLayout:
    return lay_out_clipmap(
        (0.0, 0.0, 0.0), finest_voxel_size=1.0, level_count=1, resolution=RESOLUTION
    )


def _cross(volume: VoxelVolume, layer: int, diffuse: DiffuseConesConfig) -> tuple[float, float]:
    """Mean radiance and transmittance of the set's narrowest cone along x, over distances."""
    ratio = ratio_from_aperture(min(diffuse.cones().apertures))
    near, far = DISTANCES
    if diffuse.march.max_footprint_voxels is not None:
        # Within its reach; beyond, it sees nothing at all.
        far = min(far, diffuse.march.max_footprint_voxels / ratio - 1.0)
    away = near + (far - near) * (np.arange(DISTANCE_COUNT) + 0.5) / DISTANCE_COUNT
    x = dr.maximum(mi.Float(np.float32(layer - away)), -0.5 * RESOLUTION)
    lane = dr.arange(mi.UInt32, DISTANCE_COUNT)
    choice = random_choice(lane, dr.zeros(mi.UInt32, DISTANCE_COUNT), diffuse.march.filtering)
    traced = march_cone(
        volume.choosing(choice),
        mi.Point3f(x, 0.3, -0.2),
        dr.zeros(mi.Vector3f, DISTANCE_COUNT) + mi.Vector3f(1.0, 0.0, 0.0),
        dr.full(mi.Float, ratio, DISTANCE_COUNT),
        dr.full(mi.Float, 1.0, DISTANCE_COUNT),
        diffuse.march,
        dr.full(mi.Bool, True, DISTANCE_COUNT),
    )
    dr.eval(traced)
    return float(dr.mean(traced.radiance.x)[0]), float(dr.mean(traced.transmittance)[0])
