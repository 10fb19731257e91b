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
from vctgi.maths.number_rows import entry
from vctgi.maths.recording import Recorder, run_recorded
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.extent import scene_bounds
from vctgi.scene.lights import Light
from vctgi.stages.reflective_shadow_map.dealing import (
    block_max,
    deal,
    dealt_count,
    own_texels,
    owner,
    smoothed,
)
from vctgi.stages.reflective_shadow_map.landing import LaneWindows, Windows, is_seen

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
    ray, flux
        Rays, and the power of each, W.
    windows
        The window that each is meant for.
    texel
        Number of each among those of its window.
    comes
        Whether it comes near its window at all.
    """

    ray: mi.Ray3f
    flux: mi.Color3f
    windows: LaneWindows
    texel: mi.UInt32
    comes: mi.Bool


def distant_rays(
    scene: mi.Scene,
    light: Light,
    levels: Sequence[LevelLayout],
    opacity: OpacityClipmap | None,
    limits: tuple[int, int],
) -> DistantRays:
    """Return rays of a distant light for windows.

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
    """
    cells = Cells(scene, light, levels, limits, len(levels))
    dealt, counts = cells.deal(scene, opacity)
    return cells.rays(cells.windows, dealt, *cells.lanes_of(counts))


def survey_distant(light: Light) -> float:
    """Return the estimated irradiance of a distant light, W m^-2, summed over all directions."""
    number = dr.arange(mi.UInt32, SURVEY_RAYS)
    it = dr.zeros(mi.SurfaceInteraction3f, SURVEY_RAYS)
    _, irradiance = light.emitter.sample_direction(it, kronecker_points(number))
    return float(np.mean(np.array(mi.Color3f(irradiance), dtype=np.float64)))


class Cells:
    """The coordinates of a distant light's rays for each window, in cells.

    Parameters
    ----------
    scene, light, levels, limits
        As for `distant_rays`.
    most_windows
        How many windows there may be: kernels depend on that alone, not on how many there are.
    """

    def __init__(
        self,
        scene: mi.Scene,
        light: Light,
        levels: Sequence[LevelLayout],
        limits: tuple[int, int],
        most_windows: int,
    ) -> None:
        self.light, self.limits, self.most_windows = light, limits, most_windows
        self.levels = [level.level for level in levels]
        self.resolution = levels[0].resolution
        self.axis_count = 2 if light.is_delta_direction else 4
        affordable = int((limits[0] / PILOT_RAYS_PER_CELL) ** (1.0 / self.axis_count) + 1e-6)
        self.per_axis = max(1, min(MOST_CELLS_PER_AXIS[self.axis_count], affordable))
        self.count = self.per_axis**self.axis_count
        bounds = scene_bounds(scene)
        # The last one's row stands for those that there are not.
        levels = [*levels, *[levels[-1]] * (most_windows - len(levels))]
        aims = [_aim(bounds, level) for level in levels]
        farthest = max(aim[-1] for aim in aims)
        numbers = [number for aim in aims for number in aim]
        self.windows = Windows.of(levels, bounds, numbers, farthest)

    @property
    def key(self) -> tuple[str | int, ...]:
        """All that rays depend on besides arrays.

        The light by its name, not by its place: dark lights are not among those of a frame.
        """
        numbers = (self.axis_count, self.per_axis, self.most_windows, self.resolution)
        return self.light.name, *numbers

    def deal(
        self, scene: mi.Scene, opacity: OpacityClipmap | None, recorder: Recorder | None = None
    ) -> tuple[mi.UInt32, list[int]]:
        """Return the rays of each cell, as `dealing.deal`, and how many each window gets."""
        texel_count, most_rays = self.limits
        rule = DEFAULT_RULE if opacity is None else opacity.rule
        held = None if opacity is None else opacity.levels[: opacity.layout.clip_level_count]
        cell_count = self.count * len(self.levels)
        lanes = dr.arange(mi.UInt32, cell_count * PILOT_RAYS_PER_CELL)
        cells = dr.arange(mi.UInt32, cell_count)
        if recorder is not None:
            dr.make_opaque(lanes, cells)

        def pilot(
            scene: mi.Scene,
            windows: Windows,
            lanes: tuple[mi.UInt32, mi.UInt32],
            opacity: list[mi.Float] | None,
        ) -> tuple[mi.Float, mi.UInt32]:
            return self.pilot(scene, windows, lanes, opacity, rule)

        key = ("pilot", self.key, rule)
        inputs = (scene, self.windows, (lanes, cells), held)
        weight, landing = run_recorded(recorder, key, pilot, *inputs)
        least = max(most_rays, self.count)
        counts = [least] * len(self.levels)
        if texel_count < least:
            # As many more as do not land.
            dealt = own_texels(
                deal(weight, *[texel_count] * len(self.levels)),
                dr.arange(mi.UInt32, dr.width(weight)),
                self.count,
            )
            texels = PILOT_RAYS_PER_CELL * dealt_count(self.count, texel_count)
            for place, landed in enumerate(np.array(dr.block_sum(landing * dealt, self.count))):
                wanted = math.ceil(texel_count / max(float(landed) / texels, LEAST_LANDING_SHARE))
                counts[place] = min(wanted, least)
        return deal(weight, *counts), [dealt_count(self.count, count) for count in counts]

    def lanes_of(self, counts: list[int]) -> tuple[mi.UInt32, mi.Int32]:
        """Return a lane for each of so many rays of windows, and the first lane of each window."""
        starts = [0, *accumulate(counts)][:-1]
        starts += [NO_LANE] * (self.most_windows - len(starts))
        return dr.arange(mi.UInt32, sum(counts)), mi.Int32(starts)

    def pilot(
        self,
        scene: mi.Scene,
        table: Windows,
        lanes: tuple[mi.UInt32, mi.UInt32],
        opacity: Sequence[mi.Float] | None,
        rule: SlotRule,
    ) -> tuple[mi.Float, mi.UInt32]:
        """Send a few rays of each cell; return its weight and how many of them land.

        A ray lands where it can be seen. The variance of a cell's sum goes with the mean square
        of its power, so the best share of the texels goes with the root of that.

        Parameters
        ----------
        scene, table
            What stands in the way, and the windows.
        lanes
            A number for each ray, window after window, and for each cell.
        opacity, rule
            Of all clip levels, and how thick surfaces were made in them.
        """
        ray_count = self.count * PILOT_RAYS_PER_CELL
        ray_lane, cell = lanes
        windows = LaneWindows(table, self.resolution, ray_lane // ray_count)
        lane = ray_lane % ray_count
        inside = [random_unit(lane, axis) for axis in range(self.axis_count)]
        ray, flux = self._at(table, lane // PILOT_RAYS_PER_CELL, windows.number, inside)
        comes = windows.shorten(ray)
        si = scene.ray_intersect(ray, as_mask(comes))
        power = dr.detach(channel_mean(flux))
        # A sick light is refused by name where its power is checked.
        lands = is_seen(si, mi.Vector3f(ray.d), windows, opacity, rule) & dr.isfinite(power)
        power = dr.zeros(mi.Float, dr.width(lane)) + mi.Float(dr.select(lands, power, 0.0))
        dr.eval(power)
        largest = block_max(power, ray_count)
        # Over the largest first: the square of a sun's power would overflow.
        most = dr.gather(mi.Float, largest, cell // self.count)
        squares, landing = mi.Float(0.0), mi.UInt32(0)
        for number in range(PILOT_RAYS_PER_CELL):
            found = dr.gather(mi.Float, power, PILOT_RAYS_PER_CELL * cell + number)
            relative = dr.maximum(found, 0.0) / dr.select(most > 0.0, most, 1.0)
            squares += relative * relative
            landing += dr.select(relative > 0.0, mi.UInt32(1), 0)
        own = dr.sqrt(squares * (1.0 / PILOT_RAYS_PER_CELL))
        dr.eval(own, landing)
        spread = smoothed(own, self.per_axis, self.axis_count)
        return OWN_SHARE * own + (1.0 - OWN_SHARE) * spread, landing

    def rays(
        self, table: Windows, dealt: mi.UInt32, lane: mi.UInt32, starts: mi.Int32
    ) -> DistantRays:
        """Return rays of cells, as many of each as were dealt to it.

        Parameters
        ----------
        table
            The windows.
        dealt
            What `deal` returned.
        lane, starts
            A lane for each ray, and the first of each window.
        """
        number = mi.UInt32(0)
        for place in range(1, self.most_windows):
            number += dr.select(lane >= mi.UInt32(entry(starts, place)), mi.UInt32(1), 0)
        # A new array: the lanes belong to who records this.
        lane = lane - mi.UInt32(dr.gather(mi.Int32, starts, number))
        cell = owner(dealt, number, lane, self.count)
        share = 1.0 / (self.count * mi.Float(own_texels(dealt, cell, self.count)))
        windows = LaneWindows(table, self.resolution, number)
        inside = kronecker_points(lane) if self.axis_count == 2 else kronecker_points_4d(lane)
        places = [mi.Float(each) for each in inside]
        ray, flux = self._at(table, cell % self.count, number, places)
        comes = windows.shorten(ray)
        return DistantRays(ray, flux * as_component(share), windows, lane, comes)

    def _at(
        self, table: Windows, cell: mi.UInt32, window: mi.UInt32, inside: list[mi.Float]
    ) -> tuple[mi.Ray3f, mi.Color3f]:
        """Rays at places inside cells, and the power that all light had if it were like each."""
        coordinates = []
        for place in inside:
            coordinates.append((mi.Float(cell % self.per_axis) + place) / self.per_axis)
            cell //= self.per_axis
        on_disc = mi.Point2f(coordinates[0], coordinates[1])
        towards = mi.Point2f(*coordinates[2:]) if self.axis_count == 4 else mi.Point2f(0.5)
        return self._rays(table, on_disc, towards, window)

    def _rays(
        self, table: Windows, on_disc: mi.Point2f, towards: mi.Point2f, window: mi.UInt32
    ) -> tuple[mi.Ray3f, mi.Color3f]:
        """Rays from places on the disc, in [0, 1)^2, and directions of the emitter's sampling."""
        x, y, z, radius, outside = (
            as_component(dr.gather(mi.Float, table.aims, AIM_SIZE * window + k))
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


NO_LANE = 2**31 - 1
"""Where the rays of windows begin that there are not."""

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
