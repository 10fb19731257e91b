"""Pictures and sweeps whose artefacts are known in closed form.

What a metric is worth shows on input of which the answer is known: the tests and the table of
validations (`vctgi study validation`) both read these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from metrics.flicker import Motion, motion_of
from metrics.leaking import LeakAudit

Array = NDArray[np.float64]

Noise = Callable[[np.random.Generator, tuple[int, ...]], Array]
"""Factors of a shape, of expectation one, with which light is multiplied."""


def no_noise(generator: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Return ones."""
    del generator
    return np.ones(shape)


def gaussian_noise(deviation: float) -> Noise:
    """Return normal factors of this standard deviation; a wide one takes light below zero."""
    return lambda generator, shape: 1.0 + deviation * generator.normal(size=shape)


def gamma_noise(deviation: float) -> Noise:
    """Return skewed factors of this standard deviation, which are never below zero."""
    shape_parameter = deviation**-2.0
    return lambda generator, shape: generator.gamma(
        shape_parameter, 1.0 / shape_parameter, size=shape
    )


def half_dark_light(edge: int, seed: int = 1) -> Array:
    """Return light ``(edge, edge)`` in [1, 2], and none in the right half."""
    lit = 1.0 + np.random.default_rng(seed).uniform(size=(edge, edge))
    return np.where(np.arange(edge) < edge // 2, lit, 0.0)


@dataclass(frozen=True, kw_only=True)
class LeakingPicture:
    """The picture of a half dark room, into whose dark half light leaks evenly.

    Attributes
    ----------
    through, wrong_face
        Shares of the light gathered that come through walls, and from the wrong side of one.
    missing
        Share of the light of the upper quarter that is missing.
    gain
        By what all that is gathered is too bright.
    edge
        Pixels along an edge.
    """

    through: float = 0.0
    wrong_face: float = 0.0
    missing: float = 0.0
    gain: float = 1.0
    edge: int = 24

    @property
    def truth(self) -> Array:
        """Light that should be gathered, ``(edge, edge)``."""
        return half_dark_light(self.edge)

    @property
    def seen(self) -> Array:
        """Light gathered where the apex sees it, right or wrong."""
        kept = self.truth
        kept[: self.edge // 4] *= 1.0 - self.missing
        return self.gain * (kept + self._spread(self.wrong_face))

    @property
    def leaked(self) -> Array:
        """Light gathered through walls."""
        return self.gain * self._spread(self.through)

    @property
    def missing_share(self) -> float:
        """Missing light over the light gathered; for pictures without a leak."""
        lost = self.missing * self.truth[: self.edge // 4].sum()
        return float(lost / (self.truth.sum() - lost))

    def audit(self, batch_count: int, noise: Noise = no_noise, seed: int = 0) -> LeakAudit:
        """Return an audit with noise in the truth and in what came through."""
        generator = np.random.default_rng(seed)
        shape = (batch_count, self.edge, self.edge)
        through = self.leaked * noise(generator, shape)
        return LeakAudit(
            gathered=self.seen + through,
            through=through,
            truth=self.truth * noise(generator, shape),
        )

    def _spread(self, share: float) -> Array:
        """Light of a share of all, evenly over the dark half."""
        total = share / (1.0 - self.through - self.wrong_face) * self.truth.sum()
        return np.where(self.truth > 0.0, 0.0, total / (self.truth == 0.0).sum())


@dataclass(frozen=True, kw_only=True)
class SteadySweep:
    """A smooth course of light ``(K, N, 3)`` while something crosses voxels.

    Attributes
    ----------
    places
        ``(K,)`` where it is, in voxels.
    truth
        ``(K, N, 3)``.
    """

    places: Array
    truth: Array

    def batches(self, batch_count: int, noise: Noise, seed: int = 0, own: float = 1.0) -> Array:
        """Return noisy sweeps ``(M, K, N, 3)``.

        Parameters
        ----------
        batch_count, noise, seed
            M; noise of a frame; where random numbers start.
        own
            Share of the noise that each frame has of its own; the rest is that of all frames of a
            batch, as it is where they are rendered with the same random numbers.
        """
        generator = np.random.default_rng(seed)
        shape = (batch_count, *self.truth.shape)
        alone = noise(generator, shape)
        shared = noise(generator, (batch_count, 1, *self.truth.shape[1:]))
        return self.truth * (1.0 + own * (alone - 1.0) + (1.0 - own) * (shared - 1.0))

    def rippled(self, amplitude: float, period: float = 1.0) -> Array:
        """Return the truth and waves over the mean, each receiver's with a phase of its own."""
        count = self.truth.shape[1]
        phase = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)[None, :, None]
        wave = np.sin(2.0 * np.pi * self.places[:, None, None] / period + phase)
        found: Array = self.truth + amplitude * self.truth.mean() * wave
        return found


def steady_sweep(phases: int = 16, periods: int = 2, receivers: int = 60) -> SteadySweep:
    """Return a sweep over so many voxels in so many steps to a voxel."""
    places = np.arange(phases * periods) / phases
    bright, slope, bend = np.random.default_rng(3).uniform(0.5, 1.5, (3, receivers, 3))
    along = places[:, None, None] / periods
    return SteadySweep(places=places, truth=bright + 0.05 * slope * along - 0.03 * bend * along**2)


def splatted_light(places: Array, receivers: int, width: int) -> tuple[Array, Array]:
    """Return light of a unit source that voxels hold, and that of the source itself.

    Parameters
    ----------
    places
        ``(K,)`` of the source along a line of voxels.
    receivers
        How many stand one voxel beside the line, next to the source's way.
    width
        Voxels that share the source: 1 for the nearest alone, 2 for the tent, 3 for the quadratic
        B-spline.

    Returns
    -------
    tuple
        Two arrays ``(K, N, 3)``, N receivers.
    """
    at = np.linspace(places.min(), places.max(), receivers)
    centres = np.arange(np.floor(places.min()) - 3.0, np.ceil(places.max()) + 4.0)
    away = np.abs(places[:, None] - centres)
    if width == 1:
        weights = (np.argmin(away, axis=1)[:, None] == np.arange(len(centres))).astype(float)
    elif width == 2:
        weights = np.maximum(1.0 - away, 0.0)
    else:
        weights = np.where(away < 0.5, 0.75 - away**2, 0.5 * np.maximum(1.5 - away, 0.0) ** 2)
    held = weights @ _falloff(centres[:, None] - at)
    return _grey(held), _grey(_falloff(places[:, None] - at))


def _falloff(along: Array) -> Array:
    return 1.0 / (1.0 + along**2)


def _grey(light: Array) -> Array:
    return np.repeat(light[..., None], 3, axis=-1)


def march_cycles(edge: int, per_pixel: float, degrees: float = 30.0) -> Array:
    """Return steps ``(edge, edge)`` to what is seen that grow evenly in one direction."""
    y, x = np.mgrid[0:edge, 0:edge]
    angle = np.deg2rad(degrees)
    found: Array = per_pixel * (np.cos(angle) * x + np.sin(angle) * y)
    return found


def marched_pictures(cycles: Array, phases: Array, width_steps: float) -> Array:
    """Return what marches make of a wall: one over the width of a bump, summed in steps.

    Parameters
    ----------
    cycles
        Steps to the wall, ``(H, W)``.
    phases
        Shares of a step ``(K,)`` by which starts are shifted towards their apex.
    width_steps
        Standard deviation of the bump, in steps. Sums of a Gaussian are one and a cosine of
        amplitude `march_ripple` (Poisson); the next harmonic has its fourth power.
    """
    reach = int(np.ceil(8.0 * width_steps)) + 1
    place = cycles + phases[:, None, None]
    light = np.zeros_like(place)
    for number in range(-reach, reach + 1):
        light += np.exp(-0.5 * ((place - np.floor(place) + number) / width_steps) ** 2)
    found: Array = light / (np.sqrt(2.0 * np.pi) * width_steps)
    return found


def march_ripple(width_steps: float, harmonic: int = 1) -> float:
    """Return the amplitude of the bands of `marched_pictures`, over their mean."""
    return float(2.0 * np.exp(-2.0 * (np.pi * width_steps * harmonic) ** 2))


def sliding_motion(
    frames: int = 5, height: int = 24, width: int = 32, step_px: float = 0.4
) -> tuple[Motion, Array]:
    """Return the motion of an eye that slides along a wall, and the wall's points.

    Returns
    -------
    tuple
        The motion, and points ``(K, H, W, 3)`` of the plane z = 0 in units of pixels.
    """
    y, x = np.mgrid[0:height, 0:width] + 0.5
    still = np.stack([x, y, np.zeros_like(x)], axis=-1)
    slide = np.array([step_px, 0.0, 0.0])
    points = np.stack([still + k * slide for k in range(frames)])
    normals = np.broadcast_to([0.0, 0.0, 1.0], points.shape).copy()
    # Where the eye of the frame before saw the points of frame k.
    places = np.stack([points[k][..., :2] - (k - 1) * slide[:2] for k in range(1, frames)])
    return motion_of(places, points, normals), points
