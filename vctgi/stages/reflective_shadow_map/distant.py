"""Rays of light from outside the scene, aimed at what the windows can see of it.

A ray of such light has four coordinates: the direction, in the square that the emitter's sampling
takes, and the place on a disc across that direction which covers the part of the scene in the
window. Roofs and walls stop most of them. So a coarse pilot finds in which cells of those
coordinates rays get through, and the texels are dealt to the cells in proportion. Every cell gets
at least one, and its texels share its part of the power, so that the pilot changes where the texels
are and never what they add up to (docs/decisions/0010). All windows share each launch, one after
the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.levels import LevelLayout
from vctgi.clipmap.slots import DEFAULT_RULE, SlotRule
from vctgi.clipmap.storage import OpacityClipmap
from vctgi.maths.colors import channel_mean
from vctgi.maths.directions import kronecker_points, kronecker_points_4d, random_unit
from vctgi.maths.recording import Recorder, run_recorded
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.extent import scene_bounds
from vctgi.scene.lights import Light
from vctgi.stages.reflective_shadow_map.dealing import (
    block_max,
    deal,
    deal_spare,
    dealt_count,
    owners,
    smoothed,
    spare_texels,
)
from vctgi.stages.reflective_shadow_map.landing import (
    Landings,
    LaneWindows,
    WindowTable,
    find_landings,
    is_seen,
)

PILOT_RAYS_PER_CELL = 4
"""Rays by which the pilot judges a cell."""

MOST_CELLS_PER_AXIS = {2: 256, 4: 16}
"""Cells along each coordinate, where there are two (one direction) and where there are four."""

OWN_SHARE = 0.5
"""How much a cell's texels follow its own pilot; the rest follows its neighbours, so that light
which the pilot missed at the edge of an opening does not come in few bright texels."""

SURVEY_RAYS = 256
"""Directions by which the power of a distant light is judged."""

LEAST_LANDING_SHARE = 0.25
"""A map sends out at most this number's inverse of rays for each texel that it is meant to have."""


@dataclass
class DistantRays:
    """Rays of a distant light for all windows, those of one window after those of the one before.

    Attributes
    ----------
    landings
        Rays, and where they land near their windows.
    window
        The number of the window that each is meant for.
    texel
        Number of each among those of its window.
    """

    landings: Landings
    window: mi.UInt32
    texel: mi.UInt32


@dataclass
class _Windows:
    """The windows that a distant light is aimed at, on the device.

    Attributes
    ----------
    table
        Where they stand.
    aims
        Flat [window, `AIM_SIZE`].
    """

    table: WindowTable
    aims: mi.Float


def distant_rays(
    scene: mi.Scene,
    light: Light,
    levels: Sequence[LevelLayout],
    opacity: OpacityClipmap | None,
    limits: tuple[int, int],
    recorder: Recorder | None = None,
) -> DistantRays:
    """Send rays of a distant light to windows.

    Parameters
    ----------
    scene
        What stands in the way.
    light
        A light from outside.
    levels
        The windows, of one resolution.
    opacity
        Voxels that can be seen: texels are dealt to those. None deals to all of the window.
    limits
        Texels that should land in each; rays that may be sent for that, the pilot's aside.
    recorder
        Keeps what is traced; not for what has derivatives.
    """
    texel_count, most_rays = limits
    cells = _Cells(light, levels, texel_count)
    bounds = scene_bounds(scene)
    aims = mi.Float([number for level in levels for number in _aim(bounds, level)])
    windows = _Windows(WindowTable.of(levels), aims)
    rule = DEFAULT_RULE if opacity is None else opacity.rule
    own = None if opacity is None else [opacity.levels[level.level] for level in levels]
    spare = spare_texels(cells.count, [texel_count] * len(levels))

    def pilot(
        scene: mi.Scene, windows: _Windows, opacity: list[mi.Float] | None, spare: mi.Float64
    ) -> tuple[mi.Float, mi.Float]:
        weight, landing = cells.pilot(scene, windows, opacity, rule)
        landed = mi.Float(dr.block_sum(landing * deal_spare(weight, spare), cells.count))
        dr.eval(weight, landed)
        return weight, landed

    key = (light.name, cells.key, rule)
    weight, landings = run_recorded(
        recorder, ("pilot", key, own is None), pilot, scene, windows, own, spare
    )
    texels = PILOT_RAYS_PER_CELL * dealt_count(cells.count, texel_count)
    counts = []
    for landed in np.array(landings):
        wanted = math.ceil(texel_count / max(float(landed) / texels, LEAST_LANDING_SHARE))
        counts.append(min(wanted, max(most_rays, cells.count)))
    sent = [dealt_count(cells.count, count) for count in counts]
    starts = [0, *accumulate(sent)]
    dealt = deal(weight, *counts)
    cell = owners(dealt, starts[-1])
    first = mi.UInt32(starts)
    dr.eval(dealt, cell)
    return run_recorded(
        recorder, ("distant rays", key), cells.send, scene, windows, dealt, cell, first
    )


def _cell_means(value: mi.Float) -> mi.Float:
    """Mean over the pilot's rays of each cell."""
    total: mi.Float = dr.block_sum(value, PILOT_RAYS_PER_CELL)
    return total * (1.0 / PILOT_RAYS_PER_CELL)


def survey_distant(light: Light) -> float:
    """Return the estimated irradiance of a distant light, W m^-2, summed over all directions."""
    number = dr.arange(mi.UInt32, SURVEY_RAYS)
    it = dr.zeros(mi.SurfaceInteraction3f, SURVEY_RAYS)
    _, irradiance = light.emitter.sample_direction(it, kronecker_points(number))
    return float(np.mean(np.array(mi.Color3f(irradiance), dtype=np.float64)))


class _Cells:
    """The coordinates of a distant light's rays for each window, in cells."""

    def __init__(self, light: Light, levels: Sequence[LevelLayout], texel_count: int) -> None:
        self.light = light
        self.window_count, self.resolution = len(levels), levels[0].resolution
        self.axis_count = 2 if light.is_delta_direction else 4
        affordable = int((texel_count / PILOT_RAYS_PER_CELL) ** (1.0 / self.axis_count) + 1e-6)
        self.per_axis = max(1, min(MOST_CELLS_PER_AXIS[self.axis_count], affordable))
        self.count = self.per_axis**self.axis_count

    @property
    def key(self) -> tuple[int, ...]:
        """All numbers that rays depend on besides arrays."""
        return self.axis_count, self.per_axis, self.window_count, self.resolution

    def pilot(
        self,
        scene: mi.Scene,
        windows: _Windows,
        opacity: Sequence[mi.Float] | None,
        rule: SlotRule,
    ) -> tuple[mi.Float, mi.UInt32]:
        """Send a few rays of each cell; return its weight and how many of them land.

        A ray lands where it can be seen. The variance of a cell's sum goes with the mean square
        of its power, so the best share of the texels goes with the root of that.
        """
        ray_count = self.count * PILOT_RAYS_PER_CELL
        lane = dr.arange(mi.UInt32, ray_count * self.window_count)
        lanes = LaneWindows(windows.table, self.resolution, lane // ray_count)
        lane %= ray_count
        inside = [random_unit(lane, axis) for axis in range(self.axis_count)]
        ray, flux = self._at(windows, lane // PILOT_RAYS_PER_CELL, lanes.number, inside)
        si = scene.ray_intersect(ray, as_mask(True))
        power = dr.detach(channel_mean(flux))
        # A sick light is refused by name where its power is checked.
        lands = is_seen(si, mi.Vector3f(ray.d), lanes, opacity, rule) & dr.isfinite(power)
        power = dr.zeros(mi.Float, dr.width(lane)) + mi.Float(dr.select(lands, power, 0.0))
        # Over the largest first: the square of a sun's power would overflow.
        largest = dr.gather(mi.Float, block_max(power, ray_count), lanes.number)
        power = dr.maximum(power, 0.0) / dr.select(largest > 0.0, largest, 1.0)
        landed = dr.select(power > 0.0, mi.UInt32(1), 0)
        landing = mi.UInt32(dr.block_sum(landed, PILOT_RAYS_PER_CELL))
        own = dr.sqrt(_cell_means(power * power))
        spread = smoothed(own, self.per_axis, self.axis_count)
        return OWN_SHARE * own + (1.0 - OWN_SHARE) * spread, landing

    def send(
        self,
        scene: mi.Scene,
        windows: _Windows,
        dealt: mi.UInt32,
        cell: mi.UInt32,
        starts: mi.UInt32,
    ) -> DistantRays:
        """Send rays of cells, so many of each; those of each window from its start to the next."""
        share = 1.0 / (self.count * mi.Float(dr.gather(mi.UInt32, dealt, cell)))
        own = LaneWindows(windows.table, self.resolution, cell // self.count)
        lane = dr.arange(mi.UInt32, dr.width(cell))
        lane -= dr.gather(mi.UInt32, starts, own.number)
        inside = kronecker_points(lane) if self.axis_count == 2 else kronecker_points_4d(lane)
        places = [mi.Float(each) for each in inside]
        ray, flux = self._at(windows, cell % self.count, own.number, places)
        landings = find_landings(scene, ray, flux * as_component(share), own)
        return DistantRays(landings, own.number, lane)

    def _at(
        self, windows: _Windows, cell: mi.UInt32, window: mi.UInt32, inside: list[mi.Float]
    ) -> tuple[mi.Ray3f, mi.Color3f]:
        """Rays at places inside cells, and the power that all light had if it were like each."""
        coordinates = []
        for place in inside:
            coordinates.append((mi.Float(cell % self.per_axis) + place) / self.per_axis)
            cell //= self.per_axis
        on_disc = mi.Point2f(coordinates[0], coordinates[1])
        towards = mi.Point2f(*coordinates[2:]) if self.axis_count == 4 else mi.Point2f(0.5)
        return self._rays(windows, on_disc, towards, window)

    def _rays(
        self, windows: _Windows, on_disc: mi.Point2f, towards: mi.Point2f, window: mi.UInt32
    ) -> tuple[mi.Ray3f, mi.Color3f]:
        """Rays from places on the disc, in [0, 1)^2, and directions of the emitter's sampling."""
        x, y, z, radius, outside = (
            as_component(dr.gather(mi.Float, windows.aims, AIM_SIZE * window + k))
            for k in range(AIM_SIZE)
        )
        it = dr.zeros(mi.SurfaceInteraction3f, dr.width(on_disc))
        it.p = mi.Point3f(x, y, z)
        sample, irradiance = self.light.emitter.sample_direction(it, towards)
        # Light falls from the sampled point on the distant sphere towards the window.
        d = sample.d
        disc = mi.warp.square_to_uniform_disk_concentric(on_disc) * radius
        frame = mi.Frame3f(d)
        origin = it.p + frame.s * disc.x + frame.t * disc.y + d * outside
        return mi.Ray3f(origin, -d), mi.Color3f(irradiance) * (math.pi * radius * radius)


AIM_SIZE = 5
"""Numbers that say how rays are aimed at a window."""


def _aim(bounds: tuple[np.ndarray, np.ndarray], level: LevelLayout) -> tuple[float, ...]:
    """Middle and radius of what a window holds of a scene, and how far away rays start."""
    scene_low, scene_high = bounds
    low = np.maximum(scene_low, level.window_min)
    high = np.minimum(scene_high, level.window_max)
    high = np.maximum(high, low)
    radius = max(0.5 * float(np.linalg.norm(high - low)), 0.5 * level.voxel_size)
    # From far enough that nothing of the scene stands behind the disc.
    outside = 2.0 * float(np.linalg.norm(scene_high - scene_low)) + radius
    return (*(0.5 * (low + high)).tolist(), radius, outside)
