"""Camera rays for a first look at a scene."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np

from vctgi.maths.stub_gaps import as_component


def survey_rays(sensor: mi.Sensor, resolution: int) -> mi.Ray3f:
    """Return rays through the cell centres of a grid over the whole film.

    Parameters
    ----------
    sensor
        The camera; its rays leave the middle of the lens at time 0.
    resolution
        Rays along an edge of the film, whatever its shape; lane `y * resolution + x`.
    """
    pixel = dr.arange(mi.UInt32, resolution**2)
    film = (mi.Point2f(pixel % resolution, pixel // resolution) + 0.5) / resolution
    # The second argument chooses wavelengths, which an RGB variant does not have.
    ray, _ = sensor.sample_ray(as_component(0.0), as_component(0.5), film, mi.Point2f(0.5))
    return ray


def viewer(sensor: mi.Sensor) -> tuple[np.ndarray, np.ndarray]:
    """Return where the camera stands and the unit direction in which it looks, [3] each."""
    rows = np.array(sensor.world_transform().matrix, dtype=np.float64).reshape(4, 4, -1)[..., 0]
    forward = rows[:3, 2]
    return rows[:3, 3], forward / np.linalg.norm(forward)
