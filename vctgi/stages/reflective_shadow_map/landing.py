"""What rays of light hit, and how much of their power the surface reflects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.addressing import texel_from_voxel
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.slots import SlotRule, filled_layers, surface_slot
from vctgi.maths.directions import face_forward, front_normal
from vctgi.maths.recording import Recorder, run_recorded
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.scene.reflectance import hemispherical_albedo
from vctgi.stages.reflective_shadow_map.derivative import Landing, RayOrigins, follow_lights

GRAZING_COSINE = 1e-4
"""Below it a geometric cosine is rounding, by which nothing is divided."""

WINDOW_REACH_VOXELS = 3.0
"""How far outside its window a level still keeps lit points: surfaces fill voxels behind them, up
to `clipmap.slots.MAX_THICKNESS` away."""


@dataclass
class Landings:
    """Rays of light, and where they land.

    Attributes
    ----------
    ray, flux
        The rays, and the power of each, W.
    found
        What they meet first.
    is_kept
        Which of them land where it counts.
    is_power
        Which of them carry a power that is one: not negative, infinite or NaN.
    """

    ray: mi.Ray3f
    flux: mi.Color3f
    found: mi.PreliminaryIntersection3f
    is_kept: mi.Bool
    is_power: mi.Bool


def find_landings(
    scene: mi.Scene, ray: mi.Ray3f, flux: mi.Color3f, windows: LaneWindows | None
) -> Landings:
    """Find where rays of light land.

    Parameters
    ----------
    scene
        Geometry and materials.
    ray, flux
        Rays and the power of each, W.
    windows
        The window that each point is for; those outside it are left out. None keeps all.
    """
    # Calls of emitters and shapes bring ties to all that are alive, also of other scenes.
    ray = dr.detach(ray)
    is_lit = dr.max(flux) > 0.0
    # First only which rays hit, then the surface of those.
    with dr.suspend_grad():  # type: ignore[no-untyped-call]
        found = scene.ray_intersect_preliminary(ray, as_mask(True), is_lit)
    is_kept = found.is_valid() & is_lit
    if windows is not None:
        is_kept &= as_mask(windows.are_near(mi.Point3f(ray(found.t))))
    is_power = mi.Bool(dr.all((flux >= 0.0) & dr.isfinite(flux)))
    dr.eval(found, ray, flux, is_kept, is_power)
    return Landings(ray, flux, found, mi.Bool(is_kept), is_power)


def light_landings(
    scene: mi.Scene,
    landings: Landings,
    texel: mi.UInt32,
    origins: RayOrigins | None = None,
    recorder: Recorder | None = None,
) -> tuple[ReflectiveShadowMap, mi.UInt32] | None:
    """Return the lit points of rays.

    Parameters
    ----------
    scene
        Geometry and materials.
    landings
        The rays, and where they land.
    texel
        Number of each ray within its light's map, which random decisions hash.
    origins
        What the rays were made from, where lights or surfaces have derivatives by where they are;
        None: nothing has.
    recorder
        Keeps what is traced; not for what has derivatives.

    Returns
    -------
    tuple or None
        The map, without the name of its light and for no level, and which rays its texels are, in
        their order. None if all miss.
    """
    hit = mi.UInt32(dr.compress(landings.is_kept))
    if dr.width(hit) == 0:
        return None

    def lit_points(
        _scene: mi.Scene, landings: Landings, texel: mi.UInt32, hit: mi.UInt32
    ) -> ReflectiveShadowMap:
        return _lit_points(landings, texel, hit, origins)

    found = run_recorded(recorder, "lit points", lit_points, scene, landings, texel, hit)
    return found, hit


def _lit_points(
    landings: Landings, texel: mi.UInt32, hit: mi.UInt32, origins: RayOrigins | None
) -> ReflectiveShadowMap:
    """Return the surfaces where some rays landed, and what they reflect."""
    ray = dr.gather(mi.Ray3f, landings.ray, hit)
    flux = dr.gather(mi.Color3f, landings.flux, hit)
    met = dr.gather(type(landings.found), landings.found, hit)
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
    return ReflectiveShadowMap(
        light_name="",
        level=None,
        position=si.p,
        normal=face_forward(normal, -ray.d),
        incident_flux=flux,
        reflected_flux=reflected,
    )


@dataclass
class WindowTable:
    """Windows of clip levels of one resolution, on the device.

    Attributes
    ----------
    origins
        Flat [window, axis]: lowest voxel.
    least, most
        Flat [window, axis]: least and most world coordinate that counts as near.
    voxel_sizes
        [window] world units.
    """

    origins: mi.Int32
    least: mi.Float
    most: mi.Float
    voxel_sizes: mi.Float

    @classmethod
    def of(cls, levels: Sequence[LevelLayout]) -> WindowTable:
        """Return the windows of levels."""
        least, most = [], []
        for level in levels:
            reach = WINDOW_REACH_VOXELS * level.voxel_size
            least += [x - reach for x in level.window_min]
            most += [x + reach for x in level.window_max]
        origins = mi.Int32([x for level in levels for x in level.origin])
        sizes = mi.Float([level.voxel_size for level in levels])
        return cls(origins, mi.Float(least), mi.Float(most), sizes)


@dataclass
class LaneWindows:
    """Windows of clip levels, each lane its own.

    Attributes
    ----------
    table
        All of them.
    resolution
        Voxels along their edges.
    number
        Which of them is the lane's.
    """

    table: WindowTable
    resolution: int
    number: mi.UInt32

    def are_near(self, p_world: mi.Point3f) -> mi.Bool:
        """Whether points are so near to their window that their surfaces may fill its voxels."""
        near = mi.Bool(True)
        for axis in range(3):
            row = 3 * self.number + axis
            near &= p_world[axis] >= dr.gather(mi.Float, self.table.least, row)
            near &= p_world[axis] <= dr.gather(mi.Float, self.table.most, row)
        return near

    def hold(self, voxel: mi.Vector3i) -> mi.Bool:
        """Whether voxels lie in their window."""
        inside = mi.Bool(True)
        for axis in range(3):
            origin = dr.gather(mi.Int32, self.table.origins, 3 * self.number + axis)
            inside &= mi.UInt32(voxel[axis] - origin) < self.resolution
        return inside

    def gather(self, arrays: Sequence[mi.Float], index: mi.UInt32, active: mi.Bool) -> mi.Float:
        """Return entries of arrays, one of which belongs to each window."""
        found = mi.Float(0.0)
        for number, array in enumerate(arrays):
            found += dr.gather(mi.Float, array, index, active & (self.number == number))
        return found


def is_seen(
    si: mi.SurfaceInteraction3f,
    d: mi.Vector3f,
    windows: LaneWindows,
    opacity: Sequence[mi.Float] | None,
    rule: SlotRule,
) -> mi.Bool:
    """Whether light that lands can be seen in voxels.

    Parameters
    ----------
    si, d
        Where light lands, and the direction in which it travels.
    windows
        The windows that count.
    opacity
        Their voxels, window by window; without them, all of a window counts.
    rule
        How thick surfaces were made in them.
    """
    # Light on the back of a one-sided surface goes nowhere.
    seen = windows.are_near(mi.Point3f(si.p)) & meets_front(si, d)
    if opacity is None:
        return seen
    has_slot = mi.Bool(False)
    normal = face_forward(mi.Vector3f(si.n), -d)
    voxel_size = dr.gather(mi.Float, windows.table.voxel_sizes, windows.number)
    where = mi.Point3f(si.p / as_component(voxel_size))
    resolution = windows.resolution
    for axis in range(3):
        slot = surface_slot(mi.Float(normal[axis]), rule)
        layer, is_filled = next(filled_layers(mi.Float(where[axis]), slot))
        voxel = mi.Vector3i(dr.floor(where))
        voxel[axis] = layer
        index = texel_from_voxel(voxel, resolution) + (2 * axis + slot.side) * resolution**3
        active = seen & is_filled & windows.hold(voxel)
        has_slot |= active & (windows.gather(opacity, index, active) > 0.0)
    return seen & has_slot


def meets_front(si: mi.SurfaceInteraction3f, d: mi.Vector3f) -> mi.Bool:
    """Whether light meets a surface on a side on which its BSDF does anything."""
    front, back = (mi.UInt32(int(flag)) for flag in (mi.BSDFFlags.FrontSide, mi.BSDFFlags.BackSide))
    side = dr.select(dr.dot(front_normal(si), d) < 0.0, front, back)
    return mi.Bool(si.is_valid() & ((mi.UInt32(si.bsdf().flags()) & side) != 0))
