"""What one opaque layer of voxels stops: the closed forms of the read and of the mips."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.exact_voxels import RESOLUTION, scene_of, surfaces_in
from experiments.studies.representation.thin_rays import RAYS
from vctgi.clipmap.levels import ClipmapLayout, lay_out_clipmap
from vctgi.clipmap.sampling import OPTICAL_DEPTH_CAP
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, pack_volume
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.stages.cone_tracing.march import march_cone
from vctgi.stages.downsampling import downsample
from vctgi.stages.voxelization.opacity import voxelize_opacity

MARCH_TOLERANCE = 0.05
"""Relative: what steps of half a voxel make of the integral over a layer, which is linear between
the centres of voxels."""

MIP_COUNT = 3
"""Mips between the wall and what a wide cone reads about six voxels away."""

TURNED_RAYS = 16
"""Rays that cross the layer, at different places."""


def checks() -> list[Check]:
    """Return the checks on one opaque layer."""
    through = math.exp(-OPTICAL_DEPTH_CAP)
    return [
        Check(
            name="one opaque layer, let through by the layered read",
            configuration="thin rays along the normal; trilinear alpha would let exp(-2) through",
            scene="wall of one voxel",
            measure=_let_through_by_read,
            limit_low=(1.0 - MARCH_TOLERANCE) * through,
            limit_high=(1.0 + MARCH_TOLERANCE) * through,
        ),
        Check(
            name="one opaque layer, let through by six-direction mips",
            configuration=f"level {MIP_COUNT}, what a voxel lets through along the normal",
            scene="wall of one voxel",
            measure=_let_through_by_mips,
            limit_high=0.0,
        ),
        Check(
            name="one opaque layer, let through by isotropic mips",
            configuration=f"level {MIP_COUNT}, mean over eight children; for comparison",
            scene="wall of one voxel",
            measure=_let_through_by_averages,
            goal=0.0,
        ),
    ]


def _wall() -> tuple[ClipmapLayout, OpacityClipmap]:
    """Return a wall across the window, in the layer of voxels below z = 0, facing +z."""
    layout = lay_out_clipmap(
        (0.0, 0.0, 0.0), finest_voxel_size=1.0, level_count=1, resolution=RESOLUTION
    )
    reach = float(RESOLUTION)
    corners = np.array([[-1.0, -1.0, 0.0], [3.0, -1.0, 0.0], [-1.0, 3.0, 0.0]])
    opacity = voxelize_opacity(surfaces_in(scene_of((corners * [reach, reach, 1.0])[None])), layout)
    return layout, opacity


def _let_through_by_read(_context: StudyContext) -> Measured:
    layout, opacity = _wall()
    dark = EmittanceClipmap(
        layout,
        [dr.zeros(mi.Color3f, DIRECTION_COUNT * level.voxel_count) for level in layout.levels],
        [0.0],
    )
    coarse, emittance = downsample(opacity, dark)
    assert emittance is not None, "downsampling keeps the emittance it is given"
    places = dr.arange(mi.Float, TURNED_RAYS) / TURNED_RAYS
    traced = march_cone(
        pack_volume(coarse, emittance),
        mi.Point3f(places - 0.5, 0.3 * places, 10.0 + places),
        dr.zeros(mi.Vector3f, TURNED_RAYS) + mi.Vector3f(0.0, 0.0, -1.0),
        dr.full(mi.Float, RAYS.aperture_scale, TURNED_RAYS),
        dr.full(mi.Float, 1.0, TURNED_RAYS),
        RAYS.march,
        dr.full(mi.Bool, True, TURNED_RAYS),
    )
    return Measured(value=float(dr.mean(traced.transmittance)[0]))


def _let_through_by_mips(_context: StudyContext) -> Measured:
    layout, opacity = _wall()
    coarse, _ = downsample(opacity, None)
    resolution = layout.levels[MIP_COUNT].resolution
    # A ray that travels towards -z meets the wall from its front.
    slot = np.array(coarse.levels[MIP_COUNT]).reshape(DIRECTION_COUNT, -1)[5]
    columns = slot.reshape(resolution, -1).max(axis=0)
    return Measured(value=float(1.0 - columns.min()))


def _let_through_by_averages(_context: StudyContext) -> Measured:
    _, opacity = _wall()
    fine = np.array(opacity.levels[0]).reshape(DIRECTION_COUNT, -1)[5]
    alpha = fine.reshape((RESOLUTION,) * 3)
    for _ in range(MIP_COUNT):
        half = len(alpha) // 2
        alpha = alpha.reshape(half, 2, half, 2, half, 2).mean(axis=(1, 3, 5))
    return Measured(value=float(1.0 - alpha.max(axis=0).min()))
