"""The two parts of flicker: what another seed changes, and what no seed does.

A frame is a mean over its random numbers plus noise. Renderings of one sequence with independent
seeds tell the two apart: their spread is the noise, which accumulation and sparse pixels average,
and products of different renderings hold what is left of the change beyond the truth's when it is
gone, which is the structure: patterns of traced pixels, voxels and levels under a moving eye.
Squared, both add up to the expected square of `metrics.flicker.flicker_rms`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.changes import LEAST_BATCHES, energies_of_pairs, light_of, root_of_energies
from metrics.finite import require_finite
from metrics.flicker import Motion, changes
from metrics.measurement import Measurement

STRUCTURE_FORMULA = (
    "sqrt(mean (dV_s - dR_m)(dV_t - dR_n)) / mean R over different renderings s, t and different "
    "batches m, n, d as in flicker"
)
NOISE_FORMULA = "sqrt(variance over renderings of dV, mean over pixels) / mean R, d as in flicker"


def flicker_structure(
    renderings: ArrayLike, batches: ArrayLike, motion: Motion, *, component: str = "indirect"
) -> Measurement:
    """Flicker without the noise of the frames and of the reference, as a root mean square.

    Parameters
    ----------
    renderings
        Frames with independent random numbers, ``(S, K, H, W, 3)``, S >= 3.
    batches
        Reference, ``(M, K, H, W, 3)``, M >= S: batches of independent seeds, each a whole sequence.
    motion
        Where pixels were.
    component
        Name of what is compared, for the record.

    Returns
    -------
    Measurement
        Below zero means below both noises. Its interval leaves out one rendering with its share of
        the batches at a time.

    Raises
    ------
    ValueError
        For illegal input or a reference without light.
    """
    frames, groups = _checked(renderings, batches)
    beyond = np.stack(
        [
            changes(each, motion) - changes(group, motion)
            for each, group in zip(frames, groups, strict=True)
        ]
    )[:, None]
    whole, without_one = energies_of_pairs(_mean_square, beyond)
    return Measurement.from_estimate(
        root_of_energies(
            float(whole[0]), [float(each[0]) for each in without_one], light_of(groups)
        ),
        name="flicker_structure",
        component=component,
        formula=STRUCTURE_FORMULA,
        ideal=0.0,
    )


def flicker_noise(
    renderings: ArrayLike, batches: ArrayLike, motion: Motion, *, component: str = "indirect"
) -> Measurement:
    """Noise in the change of frames, as a root mean square: what another seed changes.

    Parameters
    ----------
    renderings, batches, motion, component
        As `flicker_structure` takes them; of the reference only the mean light counts.

    Raises
    ------
    ValueError
        As `flicker_structure`.
    """
    frames, groups = _checked(renderings, batches)
    change = np.stack([changes(each, motion) for each in frames])[:, None]
    own = np.array([_mean_square(each)[0] for each in change])
    shared, shared_without = energies_of_pairs(_mean_square, change)
    return Measurement.from_estimate(
        root_of_energies(
            float(own.mean() - shared[0]),
            [
                float(np.delete(own, number).mean() - each[0])
                for number, each in enumerate(shared_without)
            ],
            light_of(groups),
        ),
        name="flicker_noise",
        component=component,
        formula=NOISE_FORMULA,
        ideal=0.0,
    )


def _mean_square(change: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([float((change**2).mean())])


def _checked(
    renderings: ArrayLike, batches: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return renderings, and as many groups of the reference, each the mean of some batches."""
    frames, reference = (np.asarray(each, dtype=np.float64) for each in (renderings, batches))
    require_finite(frames, "renderings")
    require_finite(reference, "batches")
    if frames.ndim != 5 or len(frames) < LEAST_BATCHES:
        raise ValueError(
            f"renderings must be (S, K, H, W, 3) with S >= {LEAST_BATCHES}, got {frames.shape}: "
            "render the frames with more seeds."
        )
    if reference.shape[1:] != frames.shape[1:] or len(reference) < len(frames):
        raise ValueError(
            f"batches must be (M, {', '.join(str(n) for n in frames.shape[1:])}) with "
            f"M >= {len(frames)}, got {reference.shape}: render the reference in more batches."
        )
    groups = np.stack([each.mean(axis=0) for each in np.array_split(reference, len(frames))])
    if not groups.mean() > 0.0:
        raise ValueError(f"batches must hold light, got a mean of {groups.mean()}.")
    return frames, groups
