"""What rays of light hit, and how much of their power the surface reflects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.addressing import gather_own, texel_from_voxel
from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.slots import SlotRule, filled_layers, surface_slot
from vctgi.maths.directions import face_forward, front_normal
from vctgi.maths.number_rows import entry, start_of_row
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.records import LightTexels, ReflectiveShadowMap
from vctgi.scene.reflectance import hemispherical_albedo, plain_or_sampled_albedo
from vctgi.stages.reflective_shadow_map.derivative import Landing, RayOrigins, follow_lights

GRAZING_COSINE = 1e-4
"""Below it a geometric cosine is rounding, by which nothing is divided."""

RAY_MARGIN = 1e-5
"""What rays may miss a window by, as a share of the distance that they start at: hundreds of
roundings of single precision."""

SMALLEST_COMPONENT = 1e-20
"""Components of directions are taken as at least this large where they are divided by."""

WINDOW_REACH_VOXELS = 3.0
"""How far outside its window a level still keeps lit points: surfaces fill voxels behind them, up
to `clipmap.slots.MAX_THICKNESS` away."""


def land(
    scene: mi.Scene,
    ray: mi.Ray3f,
    flux: mi.Color3f,
    windows: LaneWindows | None,
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
    windows
        The window that each point is for; those outside it are left out. None keeps all.
    texel
        Number of each ray within its light's map, which random decisions hash.
    origins
        What the rays were made from, where lights or surfaces have derivatives by where they are;
        None: nothing has.

    Returns
    -------
    tuple or None
        The map, without the name of its light and for no level, and which rays its texels are, in
        their order. None if all miss.
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
    dr.eval(found, ray, flux, is_kept)
    hit = mi.UInt32(dr.compress(is_kept))
    if dr.width(hit) == 0:
        return None
    ray = dr.gather(mi.Ray3f, ray, hit)
    flux = dr.gather(mi.Color3f, flux, hit)
    met = dr.gather(type(found), found, hit)
    with dr.suspend_grad():  # type: ignore[no-untyped-call]
        si = met.compute_surface_interaction(ray)
    normal, factor = mi.Vector3f(si.n), _turned(si, ray)
    shaded = flux * as_component(factor)
    if origins is not None:
        # The same points once more, going along with their surfaces.
        flags = int(mi.RayFlags.All) | int(mi.RayFlags.FollowShape)
        live = met.compute_surface_interaction(ray, flags)
        flux, shaded = follow_lights(Landing(live, ray.d, hit, flux, factor), origins)
    reflected = shaded * hemispherical_albedo(si, dr.gather(mi.UInt32, texel, hit))
    result = ReflectiveShadowMap(
        light_name="",
        level=None,
        position=si.p,
        normal=face_forward(normal, -ray.d),
        incident_flux=flux,
        reflected_flux=reflected,
    )
    return result, hit


def light_all(
    scene: mi.Scene,
    ray: mi.Ray3f,
    flux: mi.Color3f,
    texel: mi.UInt32,
    plain: mi.UInt32,
    aim: tuple[LaneWindows, mi.Bool] | None = None,
) -> LightTexels:
    """Find what rays light, as `land` does without derivatives, in one launch.

    Rays that light nothing keep their place, so that the host needs not know how many do.

    Parameters
    ----------
    scene, ray, flux, texel
        As for `land`.
    plain
        What `list_plain_bsdfs` returned for the scene.
    aim
        Window that each ray is for, and whether it comes there; None for lamps.
    """
    windows, comes = (None, mi.Bool(True)) if aim is None else aim
    ray, flux = dr.detach(ray), mi.Color3f(flux)
    is_bright = (dr.max(flux) > 0.0) & comes
    with dr.suspend_grad():  # type: ignore[no-untyped-call]
        found = scene.ray_intersect_preliminary(ray, as_mask(True), as_mask(is_bright))
        is_lit = mi.Bool(found.is_valid() & is_bright)
        if windows is not None:
            is_lit &= windows.are_near(mi.Point3f(ray(found.t)))
        si = found.compute_surface_interaction(ray, int(mi.RayFlags.All), as_mask(is_lit))
    shaded = flux * as_component(_turned(si, ray))
    albedo = plain_or_sampled_albedo(si, texel, plain, is_lit)
    reflected = dr.select(is_lit, shaded * albedo, 0.0)
    is_power = mi.Bool(dr.all((flux >= 0.0) & dr.isfinite(flux)))
    largest = mi.Float(dr.max(dr.detach(reflected)))
    texels = LightTexels(
        position=si.p,
        normal=face_forward(mi.Vector3f(si.n), -ray.d),
        reflected_flux=reflected,
        is_lit=is_lit,
        largest=dr.select(is_power, largest, dr.nan),
        level=None if windows is None else windows.level_numbers(),
    )
    dr.eval(texels)
    return texels


def _turned(si: mi.SurfaceInteraction3f, ray: mi.Ray3f) -> mi.Float:
    """Return by what interpolated normals change the irradiance that Mitsuba's shading sees."""
    cosine = dr.abs(dr.dot(mi.Vector3f(si.n), ray.d))
    is_grazing = cosine <= GRAZING_COSINE
    turned = dr.abs(mi.Frame3f.cos_theta(si.wi)) / dr.select(is_grazing, 1.0, cosine)
    return mi.Float(dr.select(is_grazing, 1.0, turned))


@dataclass
class Windows:
    """Windows of clip levels of one resolution, on the device.

    Attributes
    ----------
    origins
        Flat [window, axis]: lowest voxel.
    least, most
        Flat [window, axis]: least and most world coordinate that counts as near.
    voxel_sizes
        [window] world units.
    levels
        [window] clip level, and one number more: Dr.Jit would make a single one a constant.
    bounds
        Lowest and highest corner of the scene, with what rays may miss them by, and that alone.
    aims
        What rays of a light are aimed by.
    """

    origins: mi.Int32
    least: mi.Float
    most: mi.Float
    voxel_sizes: mi.Float
    levels: mi.UInt32
    bounds: mi.Float
    aims: mi.Float

    @classmethod
    def of(
        cls,
        levels: Sequence[LevelLayout],
        bounds: tuple[np.ndarray, np.ndarray],
        aims: Sequence[float],
        outside: float,
    ) -> Windows:
        """Return windows of levels.

        Parameters
        ----------
        levels
            The levels.
        bounds
            Of the scene, world units.
        aims
            As the attribute.
        outside
            How far away rays start at most, world units.
        """
        least, most = [], []
        for level in levels:
            reach = WINDOW_REACH_VOXELS * level.voxel_size
            least += [x - reach for x in level.window_min]
            most += [x + reach for x in level.window_max]
        margin = RAY_MARGIN * outside
        low, high = (np.asarray(corner, dtype=np.float64) for corner in bounds)
        return cls(
            mi.Int32([x for level in levels for x in level.origin]),
            mi.Float(least),
            mi.Float(most),
            mi.Float([level.voxel_size for level in levels]),
            mi.UInt32([*(level.level for level in levels), 0]),
            mi.Float([*(low - margin).tolist(), *(high + margin).tolist(), margin]),
            mi.Float(list(aims)),
        )


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

    table: Windows
    resolution: int
    number: mi.UInt32

    def shorten(self, ray: mi.Ray3f) -> mi.Bool:
        """End rays where they leave what is near their window; return those that come there.

        Whatever they meet elsewhere counts for nothing, so this changes no result.

        Parameters
        ----------
        ray
            Rays; their ends are changed.
        """
        table = self.table
        bounds = [mi.Float(entry(table.bounds, place)) for place in range(7)]
        enter, leave = mi.Float(0.0), mi.Float(dr.inf)
        for axis in range(3):
            row = 3 * self.number + axis
            first = dr.maximum(dr.gather(mi.Float, table.least, row) - bounds[6], bounds[axis])
            last = dr.minimum(dr.gather(mi.Float, table.most, row) + bounds[6], bounds[3 + axis])
            d = mi.Float(ray.d[axis])
            d = dr.select(dr.abs(d) < SMALLEST_COMPONENT, SMALLEST_COMPONENT, d)
            one, other = (first - ray.o[axis]) / d, (last - ray.o[axis]) / d
            enter = dr.maximum(enter, dr.minimum(one, other))
            leave = dr.minimum(leave, dr.maximum(one, other))
        leave = leave * (1.0 + RAY_MARGIN) + bounds[6]
        comes = enter * (1.0 - RAY_MARGIN) <= leave
        # Rays that never come there would end before they start.
        ray.maxt = dr.minimum(ray.maxt, as_component(dr.maximum(leave, 0.0)))
        return mi.Bool(comes)

    def level_numbers(self) -> mi.UInt32:
        """Return the level of each lane's window."""
        return dr.gather(mi.UInt32, self.table.levels, self.number + start_of_row())

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
        Voxels of all clip levels; without them, all of a window counts.
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
    resolution, level = windows.resolution, windows.level_numbers()
    for axis in range(3):
        slot = surface_slot(mi.Float(normal[axis]), rule)
        layer, is_filled = next(filled_layers(mi.Float(where[axis]), slot))
        voxel = mi.Vector3i(dr.floor(where))
        voxel[axis] = layer
        index = texel_from_voxel(voxel, resolution) + (2 * axis + slot.side) * resolution**3
        active = seen & is_filled & windows.hold(voxel)
        has_slot |= active & (gather_own(opacity, level, index, active) > 0.0)
    return seen & has_slot


def meets_front(si: mi.SurfaceInteraction3f, d: mi.Vector3f) -> mi.Bool:
    """Whether light meets a surface on a side on which its BSDF does anything."""
    front, back = (mi.UInt32(int(flag)) for flag in (mi.BSDFFlags.FrontSide, mi.BSDFFlags.BackSide))
    side = dr.select(dr.dot(front_normal(si), d) < 0.0, front, back)
    return mi.Bool(si.is_valid() & ((mi.UInt32(si.bsdf().flags()) & side) != 0))
