"""Cone sets against the exact cosine integral: ours of every count, and those of other systems."""

from __future__ import annotations

from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.peers.harmonics import band_error, even_normals
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, VoxelVolume, pack_volume
from vctgi.maths.cones import MAX_CONE_COUNT, ring_cone_set
from vctgi.maths.directions import DIRECTION_COUNT
from vctgi.maths.peer_cones import PEER_CONE_SETS, peer_cone_set
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig, trace_diffuse
from vctgi.stages.cone_tracing.march import ConeMarchConfig

DC_TOLERANCE = 1e-5
"""Largest error of what a constant environment gives."""

OUR_COUNTS = (6, 9, 16, 17, 32, 64)

KNOWN_ERRORS = {
    # Bands 1 and 2 from the survey of those systems' sources.
    "crassin6": (0.084, 0.124),
    "vctrenderer6": (0.096, 0.168),
    "four": (0.063, 0.099),
    "friduric9": (0.102, 0.162),
    "stride6": (0.155, 0.200),
    "stride12": (0.059, 0.050),
    "threejs3": (0.311, 0.213),
    "hanetaka8": (0.051, 0.099),
    "wicked16": (0.040, 0.043),
    "wicked32": (0.018, 0.022),
}
"""Errors that other systems' sets are known to have; the goals of their rows."""

GLOW = 2.0
"""Radiance of the fog that fills every voxel when the gain of a set is measured."""

POINT_COUNT = 64


def checks() -> list[Check]:
    """Return the checks on cone sets."""
    ours = [
        Check(
            name=f"{count} cones in rings, error of band {band}",
            configuration="cosine-stratified rings",
            scene="all radiance fields of the band, against the exact cosine integral",
            measure=partial(_our_error, count=count, band=band),
            goal=0.0,
        )
        for count in OUR_COUNTS
        for band in (1, 2)
    ]
    peers = [
        Check(
            name=f"{name}, error of band {band}",
            configuration="another system's cone set, weights normalised",
            scene="all radiance fields of the band, against the exact cosine integral",
            measure=partial(_peer_error, name=name, band=band),
            goal=KNOWN_ERRORS[name][band - 1] if name in KNOWN_ERRORS else None,
        )
        for name in PEER_CONE_SETS
        for band in (1, 2)
    ]
    return [
        Check(
            name=f"1 .. {MAX_CONE_COUNT} cones, largest error of a constant environment",
            configuration="cosine-stratified rings",
            scene="radiance 1 from everywhere",
            measure=_largest_gain_error,
            limit_high=DC_TOLERANCE,
        ),
        Check(
            name="sets of other systems, largest error of a constant environment",
            configuration="weights normalised, traced through glowing fog",
            scene="opaque fog of one radiance, surfaces of all orientations",
            measure=_largest_traced_error,
            limit_high=DC_TOLERANCE,
        ),
        *ours,
        *peers,
    ]


def _largest_gain_error(_context: StudyContext) -> Measured:
    counts = range(1, MAX_CONE_COUNT + 1)
    return Measured(value=max(abs(sum(ring_cone_set(n).weights) - 1.0) for n in counts))


def _our_error(_context: StudyContext, count: int, band: int) -> Measured:
    return Measured(value=band_error(ring_cone_set(count), band))


def _peer_error(_context: StudyContext, name: str, band: int) -> Measured:
    return Measured(value=band_error(peer_cone_set(name), band))


def _largest_traced_error(context: StudyContext) -> Measured:
    volume = glowing_fog()
    errors = []
    for number, name in enumerate(PEER_CONE_SETS):
        context.progress("gain of cone sets", number / len(PEER_CONE_SETS))
        errors.append(np.abs(traced_gain(volume, name) - 1.0).max())
    return Measured(value=float(max(errors)))


def traced_gain(volume: VoxelVolume, cone_set: str) -> np.ndarray:
    """E / pi [point] over the radiance of glowing fog, for surfaces of all orientations."""
    normals = even_normals(POINT_COUNT)
    config = DiffuseConesConfig(
        cone_count=peer_cone_set(cone_set).cone_count,
        cone_set=cone_set,
        # What a cone leaves unseen that ends early is no error of the set.
        march=ConeMarchConfig(min_transmittance=0.0),
    )
    found = trace_diffuse(white_receivers(np.zeros((POINT_COUNT, 3)), normals), volume, config)
    gain: np.ndarray = np.array(found, dtype=np.float64)[1] / GLOW
    return gain


def glowing_fog() -> VoxelVolume:
    """Return voxels so dense that cones end in them, all of one radiance."""
    layout = lay_out_clipmap((0.0, 0.0, 0.0), finest_voxel_size=1.0, level_count=1, resolution=32)
    counts = [DIRECTION_COUNT * level.voxel_count for level in layout.levels]
    opacity = OpacityClipmap(layout, [dr.full(mi.Float, 1.0, count) for count in counts])
    light = [dr.zeros(mi.Color3f, count) + GLOW for count in counts]
    return pack_volume(opacity, EmittanceClipmap(layout, light, [0.0]))
