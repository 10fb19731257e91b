"""Light accumulated over frames, each taking over what the one before knew of its surfaces.

A pixel's surface is looked for in the picture before, by the camera that took it. Where the four
pixels around that place show the same surface, by plane and normal, their light is blended with the
new; where they show another, or nothing, the new light stands alone. What is accumulated is
irradiance, so that textures stay where they are, and specular light, which is right only as long as
the view hardly moves. A frame with a history is no function of its inputs alone, so nothing here
runs unless it is called.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.errors import SceneError
from vctgi.maths.stub_gaps import as_component


@dataclass(frozen=True, kw_only=True)
class TemporalConfig:
    """How much of earlier frames is kept."""

    max_frame_count: int | None = 16
    """Frames that a pixel's light is the mean of at most, >= 1; beyond, the newest keeps the weight
    1 / max_frame_count and older ones fade. None: the mean over all."""
    max_plane_slope: float = 0.1
    """Distance of the old surface from the plane of the new one, over the old surface's distance
    from the pixel's own or over a pixel's width there, whichever is more, at which it is refused,
    > 0."""
    max_normal_angle: float = math.radians(20.0)
    """Angle between the normals at which it is refused, radians, (0, pi]."""

    def __post_init__(self) -> None:
        """Refuse a history of no frames, and thresholds that let nothing through."""
        if self.max_frame_count is not None and self.max_frame_count < 1:
            raise ValueError(
                f"TemporalConfig.max_frame_count must be >= 1, got {self.max_frame_count}."
            )
        if not self.max_plane_slope > 0.0:
            raise ValueError(
                f"TemporalConfig.max_plane_slope must be > 0, got {self.max_plane_slope}."
            )
        if not 0.0 < self.max_normal_angle <= math.pi:
            raise ValueError(
                f"TemporalConfig.max_normal_angle must be in (0, pi], got {self.max_normal_angle}."
            )


@dataclass(frozen=True)
class Projection:
    """Where a perspective camera shows points of the world.

    Attributes
    ----------
    film_from_world
        Rows of a matrix [4, 4] from world points to homogeneous places in the picture, pixels.
    camera_from_world
        Row [4] that gives the distance in front of the camera, world units.
    pixel_angle
        Width of a pixel at distance 1, world units.
    width, height
        Picture, pixels.
    """

    film_from_world: tuple[tuple[float, ...], ...]
    camera_from_world: tuple[float, ...]
    pixel_angle: float
    width: int
    height: int


@dataclass
class TemporalFrame:
    """What a frame knows of each pixel, and how many frames that is the mean of.

    Attributes
    ----------
    projection
        Its camera.
    irradiance
        Diffuse light over albedo, E / pi, W m^-2 sr^-1.
    specular
        W m^-2 sr^-1.
    position, normal
        World point and unit normal of the surface; a zero normal where there is none.
    frame_count
        Frames that the light is the mean of; 1 for a new one.
    """

    projection: Projection
    irradiance: mi.Color3f
    specular: mi.Color3f
    position: mi.Point3f
    normal: mi.Vector3f
    frame_count: mi.Float


def project(sensor: mi.Sensor) -> Projection:
    """Return where a camera shows points of the world.

    Raises
    ------
    SceneError
        The camera is not Mitsuba's `perspective`, or does not hold still while the shutter is open.
    """
    kind = sensor.class_name()
    if kind != "PerspectiveCamera":
        raise SceneError(
            f"frames of a {kind} cannot be followed over time",
            f"sensor '{sensor.id()}'",
            "use the sensor 'perspective', or render each frame by itself",
        )
    parameters = mi.traverse(sensor)
    film = sensor.film()
    size, crop = np.array(film.size(), float), [int(n) for n in film.crop_size()]
    offset = np.array(film.crop_offset(), float)
    world_from_camera = np.array(sensor.world_transform().matrix, dtype=np.float64)
    camera_from_world = np.linalg.inv(world_from_camera.reshape(4, 4, -1)[..., 0])
    # Mitsuba's camera looks along +z, with x to the left and y up.
    half_width = math.tan(0.5 * math.radians(float(np.ravel(parameters["x_fov"])[0])))
    focal = 0.5 * size[0] / half_width
    shift = [float(np.ravel(parameters[f"principal_point_offset_{axis}"])[0]) for axis in "xy"]
    centre = size * (0.5 - np.array(shift)) - offset
    film_from_camera = np.array(
        [
            [-focal, 0.0, centre[0], 0.0],
            [0.0, -focal, centre[1], 0.0],
            [0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0],
        ]
    )
    rows = film_from_camera @ camera_from_world
    return Projection(
        film_from_world=tuple(tuple(row) for row in rows.tolist()),
        camera_from_world=tuple(camera_from_world[2].tolist()),
        pixel_angle=1.0 / focal,
        width=crop[0],
        height=crop[1],
    )


def place_of(projection: Projection, p_world: mi.Point3f) -> tuple[mi.Point2f, mi.Float]:
    """Return where a camera shows points, pixels, and how far in front of it, world units."""
    x, y, _, w = (_row_times(row, p_world) for row in projection.film_from_world)
    depth = w
    share = 1.0 / dr.select(depth > 0.0, depth, 1.0)
    return mi.Point2f(as_component(x * share), as_component(y * share)), depth


def _row_times(row: tuple[float, ...], p_world: mi.Point3f) -> mi.Float:
    """Product of a matrix row and a point; opaque, so that all cameras share a kernel."""
    a, b, c, d = (dr.opaque(mi.Float, each) for each in row)
    return mi.Float(dr.fma(a, p_world.x, dr.fma(b, p_world.y, dr.fma(c, p_world.z, d))))


def accumulate(
    history: TemporalFrame | None, frame: TemporalFrame, config: TemporalConfig
) -> TemporalFrame:
    """Blend a frame with what earlier ones knew of its surfaces.

    Parameters
    ----------
    history
        The result of the frame before; None for the first.
    frame
        The new frame.
    config
        Weights and thresholds.

    Returns
    -------
    TemporalFrame
        The same surfaces as `frame`, with the accumulated light: history for the next.
    """
    if history is None:
        return frame
    place, depth = place_of(history.projection, frame.position)
    is_seen = (dr.squared_norm(frame.normal) > 0.0) & (depth > 0.0)
    old = _read(history, frame, place, depth, is_seen, config)
    count = old.frame_count + 1.0
    if config.max_frame_count is not None:
        count = dr.minimum(count, float(config.max_frame_count))
    share = as_component(1.0 / count)
    result = TemporalFrame(
        projection=frame.projection,
        irradiance=dr.lerp(old.irradiance, frame.irradiance, share),
        specular=dr.lerp(old.specular, frame.specular, share),
        position=frame.position,
        normal=frame.normal,
        frame_count=count,
    )
    dr.eval(result.irradiance, result.specular, result.frame_count)
    return result


@dataclass
class _Old:
    """What the history holds at the place of each new pixel; no frames where nothing fits."""

    irradiance: mi.Color3f
    specular: mi.Color3f
    frame_count: mi.Float


def _read(
    history: TemporalFrame,
    frame: TemporalFrame,
    place: mi.Point2f,
    depth: mi.Float,
    is_seen: mi.Bool,
    config: TemporalConfig,
) -> _Old:
    """Interpolate bilinearly between those of four old pixels that show the same surface."""
    width, height = history.projection.width, history.projection.height
    least_cosine = math.cos(config.max_normal_angle)
    corner = mi.Point2f(place - 0.5)
    first = mi.Point2i(dr.floor(corner))
    fraction = mi.Vector2f(corner - mi.Point2f(first))
    irradiance, specular = mi.Color3f(0.0), mi.Color3f(0.0)
    count, total = mi.Float(0.0), mi.Float(0.0)
    for dy in (0, 1):
        for dx in (0, 1):
            x, y = first.x + dx, first.y + dy
            is_inside = is_seen & (x >= 0) & (y >= 0) & (x < width) & (y < height)
            index = mi.UInt32(dr.select(is_inside, y * width + x, 0))
            normal = dr.gather(mi.Vector3f, history.normal, index)
            between = mi.Vector3f(dr.gather(mi.Point3f, history.position, index) - frame.position)
            off_plane = mi.Float(dr.abs(dr.dot(frame.normal, between)))
            apart = dr.maximum(mi.Float(dr.norm(between)), depth * history.projection.pixel_angle)
            cosine = mi.Float(dr.dot(normal, frame.normal))
            fits = is_inside & (cosine > least_cosine)
            fits &= off_plane < config.max_plane_slope * apart
            near_x = fraction.x if dx else 1.0 - fraction.x
            near_y = fraction.y if dy else 1.0 - fraction.y
            weight = dr.select(fits, mi.Float(near_x * near_y), 0.0)
            share = as_component(weight)
            irradiance = dr.fma(share, dr.gather(mi.Color3f, history.irradiance, index), irradiance)
            specular = dr.fma(share, dr.gather(mi.Color3f, history.specular, index), specular)
            count = dr.fma(weight, dr.gather(mi.Float, history.frame_count, index), count)
            total += weight
    scale = 1.0 / dr.select(total > LEAST_WEIGHT, total, 1.0)
    is_known = total > LEAST_WEIGHT
    return _Old(
        dr.select(is_known, irradiance * as_component(scale), 0.0),
        dr.select(is_known, specular * as_component(scale), 0.0),
        dr.select(is_known, count * scale, 0.0),
    )


LEAST_WEIGHT = 1e-3
"""Bilinear weight of the old pixels that fit below which they are passed over: what is left of a
neighbour that is all but out of reach."""
