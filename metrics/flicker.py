"""Flicker: what the light of a surface does as the eye moves that the true light does not.

Each pixel's surface is followed to where the picture before showed it, by exact motion vectors. The
change of its light on the way is compared with that of the reference, followed by the same vectors,
so that what resampling and the view do to both is not flicker.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.changes import light_of, mean_change_error, rms_change_error
from metrics.finite import require_finite
from metrics.measurement import Measurement

FLICKER_FORMULA = "mean |dV - dR| / mean R, d along exact motion vectors from frame to frame"
FLICKER_RMS_FORMULA = "sqrt(mean (dV - dR)^2) / mean R, d as in flicker"

LEAST_COSINE = 0.9
"""Between the normals of a pixel and of all four old pixels around its old place."""

LARGEST_SLOPE = 0.1
"""Largest distance of the old pixels from the plane of the new one, over that from its point."""


@dataclass(frozen=True)
class Motion:
    """Where the surface of each pixel was in the picture before.

    Attributes
    ----------
    places
        ``(K - 1, H, W, 2)``: for each frame but the first, the place in the one before, pixels,
        column first; the middle of the first pixel is at (0.5, 0.5).
    is_followed
        ``(K - 1, H, W)``: whether all four old pixels around it show the same surface, and none of
        these pixels touches another.
    """

    places: NDArray[np.float64]
    is_followed: NDArray[np.bool_]


def motion_of(
    places: ArrayLike,
    positions: ArrayLike,
    normals: ArrayLike,
    surfaces: ArrayLike | None = None,
) -> Motion:
    """Say which pixels can be followed.

    Parameters
    ----------
    places
        As in `Motion`, from the camera before and the points of the surfaces.
    positions, normals
        ``(K, H, W, 3)`` points and unit normals of the surfaces; a zero normal for none.
    surfaces
        ``(K, H, W)`` number of the surface that all of a pixel shows, below 0 where it shows
        several; None: one plane is one surface, although a lamp just below a ceiling is none of it.

    Raises
    ------
    ValueError
        For shapes that do not fit together, numbers that are not finite, or if nothing can be
        followed.
    """
    where, points, facing = (np.asarray(each, np.float64) for each in (places, positions, normals))
    shape = points.shape[:3]
    if points.ndim != 4 or facing.shape != points.shape or points.shape[3] != 3 or shape[0] < 2:
        raise ValueError(
            f"positions and normals must be (K, H, W, 3) with K >= 2, got {points.shape} and "
            f"{facing.shape}."
        )
    if where.shape != (shape[0] - 1, *shape[1:], 2):
        raise ValueError(
            f"places must be {(shape[0] - 1, *shape[1:], 2)}, got {where.shape}: one for each "
            "pixel of each frame but the first."
        )
    for values, name in ((where, "places"), (points, "positions"), (facing, "normals")):
        require_finite(values, name)
    alone = np.stack([_is_inner(*each) for each in zip(points, facing, strict=True)])
    known = np.zeros(shape, np.int64) if surfaces is None else np.asarray(surfaces)
    if known.shape != shape or not np.issubdtype(known.dtype, np.integer):
        raise ValueError(
            f"surfaces must be {shape} whole numbers, got {known.shape} of {known.dtype}."
        )
    alone &= np.stack([_is_among_its_own(each) for each in known])
    followed = np.stack(
        [
            _is_same_surface(where[k], points[k : k + 2], facing[k : k + 2], alone[k : k + 2])
            & _is_same_number(where[k], known[k], known[k + 1])
            for k in range(len(where))
        ]
    )
    if not followed.any():
        raise ValueError("no pixel can be followed: move the camera in smaller steps.")
    return Motion(where, followed)


def changes(frames: ArrayLike, motion: Motion) -> NDArray[np.float64]:
    """Return the change of light ``(P, 3)`` of all pixels that can be followed.

    Parameters
    ----------
    frames
        ``(K, H, W, 3)``.
    motion
        Where they were.

    Raises
    ------
    ValueError
        For another shape, or numbers that are not finite.
    """
    light = np.asarray(frames, dtype=np.float64)
    count, height, width = motion.is_followed.shape
    if light.shape != (count + 1, height, width, 3):
        raise ValueError(
            f"frames must be {(count + 1, height, width, 3)} as the motion is, got {light.shape}."
        )
    require_finite(light, "frames")
    found = []
    for old, new, places, followed in zip(
        light[:-1], light[1:], motion.places, motion.is_followed, strict=True
    ):
        before = np.zeros((int(followed.sum()), 3))
        for row, column, weight in _around(places[followed], height, width):
            before += weight[:, None] * old[row, column]
        found.append(new[followed] - before)
    return np.concatenate(found)


def flicker(
    found: ArrayLike, batches: ArrayLike, motion: Motion, *, component: str = "indirect"
) -> Measurement:
    """Mean absolute change along motion vectors beyond that of the reference.

    A distance, which takes noise for error: see `jackknife_of_distance` for its interval.

    Parameters
    ----------
    found
        Frames, ``(K, H, W, 3)``, K >= 2.
    batches
        Reference, ``(M, K, H, W, 3)``, M >= 2: batches of independent seeds, each a whole sequence.
    motion
        Where pixels were.
    component
        Name of what is compared, for the record.

    Raises
    ------
    ValueError
        For illegal input or a reference without light.
    """
    change, true_changes, light = _followed(found, batches, motion)
    return Measurement.from_estimate(
        mean_change_error(change, true_changes, light),
        name="flicker",
        component=component,
        formula=FLICKER_FORMULA,
        ideal=0.0,
    )


def flicker_rms(
    found: ArrayLike, batches: ArrayLike, motion: Motion, *, component: str = "indirect"
) -> Measurement:
    """Flicker as a root mean square, from which the reference's noise is taken out exactly.

    Parameters
    ----------
    found, batches, motion, component
        As `flicker` takes them.

    Raises
    ------
    ValueError
        As `flicker`.
    """
    change, true_changes, light = _followed(found, batches, motion)
    return Measurement.from_estimate(
        rms_change_error(change, true_changes, light),
        name="flicker_rms",
        component=component,
        formula=FLICKER_RMS_FORMULA,
        ideal=0.0,
    )


def _followed(
    found: ArrayLike, batches: ArrayLike, motion: Motion
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return changes ``(1, P, 3)``, true ones ``(M, 1, P, 3)``, and light ``(M,)``."""
    reference = np.asarray(batches, dtype=np.float64)
    if reference.ndim != 5 or len(reference) < 2:
        raise ValueError(
            f"batches must be (M, K, H, W, 3) with M >= 2, got {reference.shape}: render the "
            "reference in more batches, each with its own seed."
        )
    true_changes = np.stack([changes(batch, motion) for batch in reference])[:, None]
    light = light_of(reference)
    if not light.mean() > 0.0:
        raise ValueError(f"batches must hold light, got a mean of {light.mean()}.")
    return changes(found, motion)[None], true_changes, light


def _is_same_surface(
    places: NDArray[np.float64],
    positions: NDArray[np.float64],
    normals: NDArray[np.float64],
    is_inner: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Whether the four old pixels around each place lie on the plane of the new one ``(H, W)``."""
    height, width = places.shape[:2]
    (old, new), (old_normal, new_normal) = positions, normals
    corner = np.floor(places - 0.5)
    is_inside = (corner >= 0) & (corner <= [width - 2, height - 2])
    same = np.asarray(is_inside.all(axis=-1), dtype=np.bool_)
    same &= is_inner[1]
    near = []
    for row, column, _ in _around(places, height, width):
        near.append((old[row, column], old_normal[row, column]))
        same &= is_inner[0][row, column]
    return same & _is_on_plane(new, new_normal, near)


def _is_inner(positions: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether a pixel and its eight neighbours show one surface ``(H, W)``.

    A pixel that an edge runs through shows a mix of two surfaces, which no motion vector follows.
    """
    height, width = positions.shape[:2]
    points, facing = (
        np.pad(each, ((1, 1), (1, 1), (0, 0)), mode="edge") for each in (positions, normals)
    )
    tiles = [np.s_[y : y + height, x : x + width] for y in range(3) for x in range(3)]
    return _is_on_plane(positions, normals, [(points[tile], facing[tile]) for tile in tiles])


def _is_among_its_own(surfaces: NDArray[np.int_]) -> NDArray[np.bool_]:
    """Whether a pixel and its eight neighbours show nothing but one surface ``(H, W)``."""
    height, width = surfaces.shape
    padded = np.pad(surfaces, 1, mode="edge")
    near = [padded[y : y + height, x : x + width] for y in range(3) for x in range(3)]
    return np.asarray((surfaces >= 0) & np.all([each == surfaces for each in near], axis=0))


def _is_same_number(
    places: NDArray[np.float64], old: NDArray[np.int_], new: NDArray[np.int_]
) -> NDArray[np.bool_]:
    """Whether the old pixels around each place show the surface of the new one ``(H, W)``."""
    around = _around(places, *new.shape)
    return np.asarray(np.all([old[row, column] == new for row, column, _ in around], axis=0))


def _is_on_plane(
    point: NDArray[np.float64],
    normal: NDArray[np.float64],
    near: list[tuple[NDArray[np.float64], NDArray[np.float64]]],
) -> NDArray[np.bool_]:
    """Whether all points near each of these lie on its plane and face as it does ``(H, W)``."""
    apart, off_plane = np.zeros(point.shape[:2]), np.zeros(point.shape[:2])
    fits = np.asarray(normal.any(axis=-1), dtype=np.bool_)
    for other, other_normal in near:
        between = other - point
        apart = np.maximum(apart, np.linalg.norm(between, axis=-1))
        off_plane = np.maximum(off_plane, np.abs((between * normal).sum(axis=-1)))
        fits &= (other_normal * normal).sum(axis=-1) > LEAST_COSINE
    fits &= off_plane <= LARGEST_SLOPE * apart
    return fits


def _around(
    places: NDArray[np.float64], height: int, width: int
) -> list[tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.float64]]]:
    """Return row, column and bilinear weight of each of the four pixels around places.

    Pixels beyond the rim stand for the nearest inside; who asks leaves those places out.
    """
    corner = np.floor(places - 0.5)
    share = places - 0.5 - corner
    found = []
    for dy in (0, 1):
        for dx in (0, 1):
            weight = np.abs(1 - dx - share[..., 0]) * np.abs(1 - dy - share[..., 1])
            column = np.clip(corner[..., 0] + dx, 0, width - 1).astype(int)
            row = np.clip(corner[..., 1] + dy, 0, height - 1).astype(int)
            found.append((row, column, weight))
    return found
