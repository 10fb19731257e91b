"""Camera rays through pixel centres, one a pixel, for pictures of voxels."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.maths.stub_gaps import as_component

LONE_PIXEL_ANGLE = 1e-3
"""Angle of the pixel of a picture that has only one, radians."""


@dataclass
class PixelRays:
    """Rays of a picture.

    Attributes
    ----------
    origin, direction
        World points and unit vectors, lane `y * width + x`.
    width, height
        Of the picture, pixels.
    """

    origin: mi.Point3f
    direction: mi.Vector3f
    width: int
    height: int

    def picture(
        self, values: mi.Float | mi.Bool | mi.Color3f | mi.Point3f | mi.Vector3f
    ) -> np.ndarray:
        """Return one value a ray as an array [y, x] or [y, x, channel]."""
        flat = np.array(values)
        # A number that is the same for all rays is one lane wide.
        flat = np.broadcast_to(flat, (*flat.shape[:-1], self.width * self.height))
        return flat.T.reshape(self.height, self.width, *flat.shape[:-1])

    @property
    def pixel_angle(self) -> float:
        """Median angle between the rays of neighbouring pixels, radians."""
        d = self.picture(self.direction).astype(np.float64)
        steps = [np.linalg.norm(np.diff(d, axis=axis), axis=-1).ravel() for axis in (0, 1)]
        angles = np.concatenate(steps)
        return float(np.median(angles)) if angles.size else LONE_PIXEL_ANGLE


def pixel_rays(sensor: mi.Sensor, longest: int | None = None) -> PixelRays:
    """Return the rays through the middle of each pixel, from the middle of the lens, at time 0.

    Parameters
    ----------
    sensor
        The camera, of any kind; only the part of its film within the crop window is seen.
    longest
        Pixels along the longer edge, where the film's own number is larger; None for the film's.
    """
    film = sensor.film()
    crop = [int(n) for n in film.crop_size()]
    scale = 1.0 if longest is None else min(1.0, longest / max(crop))
    width, height = (max(1, round(scale * n)) for n in crop)
    pixel = dr.arange(mi.UInt32, width * height)
    place = (mi.Point2f(pixel % width, pixel // width) + 0.5) / mi.Point2f(width, height)
    size, offset = film.size(), film.crop_offset()
    low, extent = (
        mi.Point2f(*(float(a) / float(b) for a, b in zip(v, size, strict=True)))
        for v in (offset, crop)
    )
    ray, _ = sensor.sample_ray(
        as_component(0.0), as_component(0.5), place * extent + low, mi.Point2f(0.5)
    )
    dr.eval(ray)
    return PixelRays(ray.o, ray.d, width, height)
