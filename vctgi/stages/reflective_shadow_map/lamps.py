"""Rays of all lamps inside the scene, in one launch, and how many each of them gets.

A texel should be smaller than a voxel's face of the level that it lights. How many faces a lamp
lights is estimated from a few rays: a texel of solid angle w that lands at distance t under cosine
c covers w t^2 / c. Lamps that together want more than there is share it by power: the error of a
voxel goes with the sum of (power of a lamp)^2 / texels, which that makes least.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.clipmap.levels import ClipmapLayout
from vctgi.maths.directions import face_forward, kronecker_points_4d, offset_from_surface
from vctgi.maths.number_rows import FloatRow, start_of_row
from vctgi.maths.stub_gaps import as_component, as_mask
from vctgi.scene.extent import half_extent_number
from vctgi.scene.lights import Light
from vctgi.scene.registry import registry_number
from vctgi.stages.reflective_shadow_map.landing import meets_front

LEAST_TEXELS = 64
"""Texels of the smallest map, where there are many lamps."""

LEAST_WANTED = 4096
"""Texels that every lamp is given where there are enough, however little it lights."""

EVEN = 1e-5
"""Relative difference between powers of rays that rounding explains."""

SURVEY_EDGE = 16
"""Rays along an edge of the map by which a lamp's need is estimated."""

LEAST_LANDINGS = 16
"""Rays of the survey that must land for an estimate; a lamp that so few do gets a full map."""

GRAZING = 0.1
"""Cosines are taken as at least this large: flatter light is spread thin on purpose."""


@dataclass
class LampRays:
    """Rays that share the power of lamps.

    Attributes
    ----------
    ray
        The rays.
    weight
        The power that all light of the lamp had if it were like each, W.
    which
        The place of its lamp in the list.
    texel
        Its number among the lamp's.
    position, direction
        Samples of its place on the lamp and of its direction, [0, 1)^2.
    """

    ray: mi.Ray3f
    weight: mi.Color3f
    which: mi.UInt32
    texel: mi.UInt32
    position: mi.Point2f
    direction: mi.Point2f


def lamp_rays(
    scene: mi.Scene,
    lights: list[Light],
    counts: np.ndarray,
    layout: ClipmapLayout,
    *,
    is_survey: bool = False,
) -> LampRays:
    """Return rays that share the power of lamps.

    Parameters
    ----------
    scene, layout
        They set the distance at which rays leave a lamp's own surface.
    lights
        Finite lights.
    counts
        [light] texels of each; square numbers for those with two coordinates only.
    is_survey
        Whether all rays with two coordinates lie on a grid, so that neighbours can be compared.

    Returns
    -------
    LampRays
        The rays.
    """
    total = int(counts.sum())
    firsts = np.cumsum(counts) - counts
    edges = np.maximum(np.sqrt(counts).round(), 1)
    numbers = [registry_number(mi.EmitterPtr(light.emitter)) for light in lights]
    columns = (firsts, edges, numbers, [_bits(light) for light in lights])
    # All in one table: each array of the host is copied to the device by itself.
    table = lamp_table(np.array(columns, dtype=np.int64).ravel().tolist())
    lane, count = dr.arange(mi.UInt32, total), len(lights)
    which = lane - lane
    if count > 1:
        after = dr.binary_search(  # type: ignore[no-untyped-call]
            1, count, lambda lamp: dr.gather(mi.UInt32, table, lamp) <= lane
        )
        which = mi.UInt32(after) - 1
    first, edge, number, kind = (
        dr.gather(mi.UInt32, table, which + (column * count + start_of_row()))
        for column in range(len(columns))
    )
    # Unused lanes gather 0, by which the CPU must not divide.
    texel, edge = lane - first, dr.maximum(edge, 1)
    emitter = cast("mi.EmitterPtr", dr.reinterpret_array(mi.EmitterPtr, number))

    # An area light has four coordinates, evenly filled in all of them together. Directions of a
    # point and positions of a lamp that shines one way lie on a grid. A spot takes its direction
    # from the first pair: scattered, it integrates a falloff whose rings run along a grid's lines.
    grid = (mi.Point2f(texel % edge, texel // edge) + 0.5) / as_component(mi.Float(edge))
    spread = kronecker_points_4d(texel)
    is_flat = (kind & (ONE_PLACE | ONE_DIRECTION)) != 0
    on_grid = is_flat if is_survey else (kind & ONE_DIRECTION) != 0
    position = dr.select(on_grid, grid, mi.Point2f(spread[0], spread[1]))
    direction = dr.select(is_flat, grid, mi.Point2f(spread[2], spread[3]))
    ray, weight = emitter.sample_ray(as_component(0.0), as_component(0.5), position, direction)
    # Mitsuba starts rays at a distance from an area light that a small scene does not have.
    is_area = as_mask((kind & AREA) != 0)
    on_lamp, _ = emitter.sample_position(as_component(0.0), position, is_area)
    side = face_forward(mi.Vector3f(on_lamp.n), ray.d)
    half = half_extent_number(scene, layout.extent)
    start = offset_from_surface(on_lamp.p, side, FloatRow([half, half])[0])
    ray.o = dr.select(is_area, start, ray.o)
    return LampRays(ray, mi.Color3f(weight), which, texel, position, direction)


def lamp_table(values: Sequence[int]) -> mi.UInt32:
    """Return a whole number of each lamp, on the device.

    Copied and opaque: a NumPy array would be read in place, and by another kernel each time that
    its memory is aligned otherwise.
    """
    table = mi.UInt32(list(values))
    dr.make_opaque(table)
    return table


ONE_PLACE, ONE_DIRECTION, AREA = 1, 2, 4
"""Bits that say what a lamp's rays have in common."""


def _bits(light: Light) -> int:
    bits = ONE_PLACE * light.is_delta_position + AREA * (light.kind == "AreaLight")
    return bits + ONE_DIRECTION * (light.is_delta_direction and not light.is_delta_position)


@dataclass(frozen=True, kw_only=True)
class LampSurvey:
    """What a few rays tell of lamps.

    Attributes
    ----------
    power
        [light] estimated power, W; NaN where it is none.
    landed
        [light] rays that met a surface.
    met_front
        [light] rays that met a side which its BSDF lets reflect or transmit.
    lit_faces
        [light] estimated number of voxel faces that the light falls on, of the finest level there.
    is_even
        [light] whether all its rays carry the same power.
    ray_count
        Rays of each lamp.
    """

    power: np.ndarray
    landed: np.ndarray
    met_front: np.ndarray
    lit_faces: np.ndarray
    is_even: np.ndarray
    ray_count: int


def survey_lamps(
    scene: mi.Scene, lights: list[Light], layout: ClipmapLayout, edge: int = SURVEY_EDGE
) -> LampSurvey:
    """Send `edge`^2 rays from each lamp and see where they land."""
    count = len(lights)
    rays = lamp_rays(scene, lights, np.full(count, edge * edge), layout, is_survey=True)
    ray, weight = rays.ray, rays.weight
    si = scene.ray_intersect(ray, as_mask(True))
    front = meets_front(si, mi.Vector3f(ray.d))
    distance = dr.select(si.is_valid(), si.t, 0.0)
    landed, met, t, hits, d, o, n, carried = _read(
        (mi.Float(dr.select(si.is_valid(), mi.Float(1.0), 0.0)), 1),
        (mi.Float(dr.select(front, mi.Float(1.0), 0.0)), 1),
        (mi.Float(distance), 1),
        *((part, 3) for part in (si.p, ray.d, ray.o, si.n, weight)),
    )
    shape = (count, edge, edge)
    landed = landed.reshape(shape) > 0.0
    hits, d, o, n = (each.T.reshape(*shape, 3) for each in (hits, d, o, n))
    cosine = np.maximum(np.abs(np.einsum("...i,...i", n, d)), GRAZING)
    t = t.reshape(shape)
    beam = np.zeros(shape)
    for number, light in enumerate(lights):
        if light.is_delta_direction and not light.is_delta_position:
            beam[number] = _cell_areas(o[number])
        elif light.is_delta_position:
            beam[number] = _cell_areas(d[number]) * t[number] ** 2
        else:
            # Mean solid angle of a cosine-distributed direction.
            beam[number] = 2.0 * math.pi / edge**2 * t[number] ** 2
    faces = np.where(landed, beam / (cosine * _face_areas(hits, layout)), 0.0)
    carried = carried.reshape(3, count, -1)
    return LampSurvey(
        power=carried.mean(axis=(0, 2)),
        is_even=(carried.max(axis=2) <= (1.0 + EVEN) * carried.min(axis=2)).all(axis=0),
        landed=landed.sum(axis=(1, 2)),
        met_front=(met.reshape(count, -1) > 0.0).sum(axis=1),
        lit_faces=faces.sum(axis=(1, 2)),
        ray_count=edge * edge,
    )


def _read(*parts: tuple[Any, int]) -> list[np.ndarray]:
    """Read arrays of so many channels at once, each as [channel, lane]; all as wide as the last."""
    channels = [
        mi.Float(part if count == 1 else part[channel])
        for part, count in parts
        for channel in range(count)
    ]
    width = dr.width(parts[-1][0])
    flat = dr.empty(mi.Float, len(channels) * width)
    lane = dr.arange(mi.UInt32, width)
    for place, channel in enumerate(channels):
        dr.scatter(flat, channel, lane + place * width, mode=dr.ReduceMode.NoConflicts)
    rows = np.array(flat, dtype=np.float64).reshape(-1, width)
    return np.split(rows, np.cumsum([count for _, count in parts])[:-1])


def _cell_areas(points: np.ndarray) -> np.ndarray:
    """Area [row, column] of the cells of a surface known on a grid of points [row, column, 3]."""
    along, across = np.gradient(points, axis=0), np.gradient(points, axis=1)
    areas: np.ndarray = np.linalg.norm(np.cross(along, across), axis=-1)
    return areas


def _face_areas(points: np.ndarray, layout: ClipmapLayout) -> np.ndarray:
    """Area of a voxel's face of the finest level around points [..., 3]; infinite outside all."""
    areas = np.full(points.shape[:-1], np.inf)
    for level in reversed(layout.clip_levels):
        is_inside = ((points >= level.window_min) & (points < level.window_max)).all(axis=-1)
        areas[is_inside] = level.voxel_size**2
    return areas


def deal_texels(
    scene: mi.Scene,
    lights: list[Light],
    layout: ClipmapLayout,
    texels_per_face: float,
    limits: tuple[int, int],
) -> np.ndarray:
    """Return the texels of each lamp.

    Parameters
    ----------
    scene, lights
        Finite lights, and what they shine on.
    layout
        Levels that they light.
    texels_per_face
        Texels for each face of a voxel that a lamp lights.
    limits
        Most texels of one lamp; of all together.
    """
    survey = survey_lamps(scene, lights, layout)
    full, most = limits
    wanted = np.clip(texels_per_face * survey.lit_faces, min(LEAST_WANTED, full), full)
    # Uneven power is integrated by the texels, whatever they light.
    wanted[(survey.landed < LEAST_LANDINGS) | ~survey.is_even] = full
    counts = share_texels(wanted, np.nan_to_num(survey.power), most)
    edges = np.maximum(np.floor(np.sqrt(counts)), 1.0)
    # Where one coordinate pair is all that a lamp has, its texels form a square.
    has_four = [not (light.is_delta_position or light.is_delta_direction) for light in lights]
    dealt: np.ndarray = np.where(has_four, np.floor(counts), edges**2).astype(np.int64)
    return dealt


def share_texels(wanted: np.ndarray, power: np.ndarray, most: int) -> np.ndarray:
    """Return how many texels lamps get that want so many, of at most `most` in all.

    Each gets what it wants if that can be; else all get texels in proportion to their power, but
    none less than `LEAST_TEXELS` or more than it wants.
    """
    if wanted.sum() <= most:
        return wanted
    least = np.minimum(wanted, LEAST_TEXELS)
    low, high = 0.0, 1.0
    share = np.maximum(power, 0.0) / max(float(power.max()), np.finfo(float).tiny) * wanted.max()
    while np.clip(high * share, least, wanted).sum() < most and high < LARGEST_FACTOR:
        high *= 2.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if np.clip(middle * share, least, wanted).sum() <= most:
            low = middle
        else:
            high = middle
    dealt: np.ndarray = np.clip(low * share, least, wanted)
    return dealt


LARGEST_FACTOR, BISECTIONS = 2.0**60, 80
"""Bounds of the search for the common factor of texels per power."""
