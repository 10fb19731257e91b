"""The near field: real rays for the first voxels of a cone.

A voxel cannot tell the two faces of a wall that is thinner than itself, nor a surface from what
touches it, so a cone that starts next to them sees the wrong one. Over its first voxels each cone
is therefore replaced by a ray along its axis. Where the ray hits, the surface's radiance is read
from its own voxel and slot; where it hits nothing, the cone goes on from the ray's end.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.sampling import read_surface
from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.directions import face_forward, offset_from_surface
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.extent import half_extent
from vctgi.stages.cone_tracing.march import finest_level


@dataclass
class NearField:
    """What the rays found.

    Attributes
    ----------
    is_hit
        Whether a surface that the voxels know lies within reach.
    radiance
        Its radiance, W m^-2 sr^-1; 0 where nothing was hit.
    reach
        Length of the rays, world units.
    distance
        How far away the surface is, world units; meaningless where nothing was hit.
    """

    is_hit: mi.Bool
    radiance: mi.Color3f
    reach: mi.Float
    distance: mi.Float


def trace_near_field(
    scene: mi.Scene,
    volume: VoxelVolume,
    apex: mi.Point3f,
    normal: mi.Vector3f,
    axis: mi.Vector3f,
    reach_voxels: float,
    active: mi.Bool,
) -> NearField:
    """Trace one short ray along each cone.

    Parameters
    ----------
    scene
        Geometry.
    volume
        Lit voxels, which hold the radiance of what is hit.
    apex, normal, axis
        Start of the cones, the surface's normal there, the cones' unit directions.
    reach_voxels
        Length of the rays in voxels of the finest level that holds the apex, > 0.
    active
        Lanes to trace.
    """
    # The coarser of the levels that the apex lies between: its window also holds the ray's end.
    level = mi.UInt32(dr.ceil(finest_level(volume, apex)))
    voxel_size = volume.layout.finest_voxel_size * dr.exp2(mi.Float(level))
    reach = reach_voxels * voxel_size
    scale = half_extent(scene, volume.layout.extent)
    ray = mi.Ray3f(offset_from_surface(apex, normal, scale), axis)
    ray.maxt = as_component(reach)
    si = scene.ray_intersect(ray, int(mi.RayFlags.Minimal), as_mask(False), as_mask(active))
    is_hit = mi.Bool(si.is_valid()) & active
    facing = face_forward(mi.Vector3f(si.n), -axis)
    radiance, opacity = read_surface(volume, level, si.p, facing, is_hit)
    # The side that nobody looks at is in no slot: black, as the back of a lamp, but in the way.
    _, behind = read_surface(volume, level, si.p, -facing, is_hit & (opacity <= 0.0))
    # A surface without opacity, cut away by a mask or missed by the sampled coverage, is not there.
    is_hit &= (opacity > 0.0) | (behind > 0.0)
    return NearField(is_hit, dr.select(is_hit, radiance, 0.0), reach, mi.Float(si.t))
