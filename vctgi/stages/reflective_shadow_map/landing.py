"""What rays of light hit, and how much of their power the surface reflects."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import is_inside, texel_from_voxel
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.slots import filled_layers, surface_slot
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.maths.directions import face_forward, front_normal
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.scene.reflectance import hemispherical_albedo
from vctgi.stages.reflective_shadow_map.derivative import Landing, RayOrigins, follow_lights

GRAZING_COSINE = 1e-4
"""Below it a geometric cosine is rounding, by which nothing is divided."""

WINDOW_REACH_VOXELS = 3.0
"""How far outside its window a level still keeps lit points: surfaces fill voxels behind them, up
to `clipmap.slots.MAX_THICKNESS` away."""


def land(
    scene: mi.Scene,
    ray: mi.Ray3f,
    flux: mi.Color3f,
    level: LevelLayout | None,
    texel: mi.UInt32,
    origins: RayOrigins | None = None,
) -> tuple[ReflectiveShadowMap, mi.UInt32] | None:
    """Find the lit points of rays.

    Parameters
    ----------
    scene
        Geometry and materials.
    ray, flux
        Rays and the power of each, W.
    level
        The level that the points are for; those outside its window are left out. None keeps all.
    texel
        Number of each ray within its light's map, which random decisions hash.
    origins
        What the rays were made from, where lights or surfaces have derivatives by where they are;
        None: nothing has.

    Returns
    -------
    tuple or None
        The map, without the name of its light, and which rays its texels are. None if all miss.
    """
    # Calls of emitters and shapes bring ties to all that are alive, also of other scenes.
    ray = dr.detach(ray)
    is_lit = dr.max(flux) > 0.0
    # First only which rays hit, then the surface of those.
    with dr.suspend_grad():  # type: ignore[no-untyped-call]
        found = scene.ray_intersect_preliminary(ray, as_mask(True), is_lit)
    is_kept = found.is_valid() & is_lit
    if level is not None:
        is_kept &= as_mask(is_near(mi.Point3f(ray(found.t)), level))
    dr.eval(found, ray, flux, is_kept)
    hit = mi.UInt32(dr.compress(is_kept))
    if dr.width(hit) == 0:
        return None
    ray = dr.gather(mi.Ray3f, ray, hit)
    flux = dr.gather(mi.Color3f, flux, hit)
    met = dr.gather(type(found), found, hit)
    with dr.suspend_grad():  # type: ignore[no-untyped-call]
        si = met.compute_surface_interaction(ray)
    normal = mi.Vector3f(si.n)
    cosine = dr.abs(dr.dot(normal, ray.d))
    # Interpolated normals change the irradiance that Mitsuba's shading sees; so must ours.
    is_grazing = cosine <= GRAZING_COSINE
    turned = dr.abs(mi.Frame3f.cos_theta(si.wi)) / dr.select(is_grazing, 1.0, cosine)
    factor = mi.Float(dr.select(is_grazing, 1.0, turned))
    shaded = flux * as_component(factor)
    if origins is not None:
        # The same points once more, going along with their surfaces.
        flags = int(mi.RayFlags.All) | int(mi.RayFlags.FollowShape)
        live = met.compute_surface_interaction(ray, flags)
        flux, shaded = follow_lights(Landing(live, ray.d, hit, flux, factor), origins)
    reflected = shaded * hemispherical_albedo(si, dr.gather(mi.UInt32, texel, hit))
    result = ReflectiveShadowMap(
        light_name="",
        level=None if level is None else level.level,
        position=si.p,
        normal=face_forward(normal, -ray.d),
        incident_flux=flux,
        reflected_flux=reflected,
    )
    return result, hit


def is_near(p_world: mi.Point3f, level: LevelLayout) -> mi.Bool:
    """Whether points are so near to a level's window that their surfaces may fill its voxels."""
    reach = WINDOW_REACH_VOXELS * level.voxel_size
    inside = mi.Bool(True)
    for axis in range(3):
        low = dr.opaque(mi.Float, level.window_min[axis] - reach)
        high = dr.opaque(mi.Float, level.window_max[axis] + reach)
        inside &= (p_world[axis] >= low) & (p_world[axis] <= high)
    return inside


def is_seen(
    si: mi.SurfaceInteraction3f,
    d: mi.Vector3f,
    level: LevelLayout,
    opacity: OpacityClipmap | None,
) -> mi.Bool:
    """Whether light that lands can be seen in a level's voxels.

    Parameters
    ----------
    si, d
        Where light lands, and the direction in which it travels.
    level
        The level.
    opacity
        Its voxels; without them, all of its window counts.
    """
    # Light on the back of a one-sided surface goes nowhere.
    seen = is_near(mi.Point3f(si.p), level) & meets_front(si, d)
    if opacity is None:
        return seen
    has_slot = mi.Bool(False)
    normal = face_forward(mi.Vector3f(si.n), -d)
    where = si.p / level.voxel_size
    for axis in range(3):
        slot = surface_slot(mi.Float(normal[axis]), opacity.rule)
        layer, is_filled = next(filled_layers(mi.Float(where[axis]), slot))
        voxel = mi.Vector3i(dr.floor(where))
        voxel[axis] = layer
        index = texel_from_voxel(voxel, level.resolution)
        index += (2 * axis + slot.side) * level.voxel_count
        active = seen & is_filled & is_inside(voxel, level)
        has_slot |= active & (dr.gather(mi.Float, opacity.levels[level.level], index, active) > 0.0)
    return seen & has_slot


def meets_front(si: mi.SurfaceInteraction3f, d: mi.Vector3f) -> mi.Bool:
    """Whether light meets a surface on a side on which its BSDF does anything."""
    front, back = (mi.UInt32(int(flag)) for flag in (mi.BSDFFlags.FrontSide, mi.BSDFFlags.BackSide))
    side = dr.select(dr.dot(front_normal(si), d) < 0.0, front, back)
    return mi.Bool(si.is_valid() & ((mi.UInt32(si.bsdf().flags()) & side) != 0))
