"""Whether two sets of independent image batches have the same expectation."""

from __future__ import annotations

import mitsuba as mi
import numpy as np
from scipy import stats

SIGNIFICANCE = 1e-4
"""Chance that a true equality is called false, over all blocks of an image together. Low, because
Mitsuba merges meshes in another order in each process and so draws anew; the mutants that must be
seen lie below it too."""
BLOCK = 4
"""Pixels along the edge of a block: averaging makes each number more nearly Gaussian."""


def path_batches(
    scene: mi.Scene, max_depth: int, *, samples: int, count: int, seed: int = 1000
) -> np.ndarray:
    """Images of Mitsuba's own path tracer, one per seed: `[batch, y, x, rgb]`."""
    integrator = mi.load_dict({"type": "path", "max_depth": max_depth})
    images = [
        np.asarray(
            mi.render(scene, integrator=integrator, spp=samples, seed=mi.UInt32(seed + index))
        )
        for index in range(count)
    ]
    return np.stack(images)[..., :3]


def block_means(batches: np.ndarray) -> np.ndarray:
    """Average over blocks of pixels: `[batch, number]`, the last number is the whole image's."""
    count, height, width, _ = batches.shape
    cut = batches[:, : height - height % BLOCK, : width - width % BLOCK].astype(np.float64)
    rows, columns = cut.shape[1] // BLOCK, cut.shape[2] // BLOCK
    blocks = cut.reshape(count, rows, BLOCK, columns, BLOCK, 3).mean(axis=(2, 4))
    whole = cut.mean(axis=(1, 2, 3))
    return np.concatenate([blocks.reshape(count, -1), whole[:, None]], axis=1)


def least_p_value(first: np.ndarray, second: np.ndarray) -> float:
    """Smallest p-value over the blocks by Welch's test, corrected after Sidak.

    Both sides' variances count. A block without any spread on either side must be equal up to
    float32 rounding.
    """
    a, b = block_means(first), block_means(second)
    variance = a.var(axis=0, ddof=1) / len(a) + b.var(axis=0, ddof=1) / len(b)
    difference = np.abs(a.mean(axis=0) - b.mean(axis=0))
    rounding = 1e-6 * np.maximum(np.abs(a.mean(axis=0)), 1e-6)
    varying = variance > rounding**2
    assert (difference[~varying] <= 10 * rounding[~varying]).all(), "blocks without noise differ"
    if not varying.any():
        return 1.0
    p_values = stats.ttest_ind(a[:, varying], b[:, varying], axis=0, equal_var=False).pvalue
    least = float(np.min(p_values))
    return float(-np.expm1(len(p_values) * np.log1p(-least)))


def assert_same_expectation(first: np.ndarray, second: np.ndarray) -> None:
    least = least_p_value(first, second)
    assert least > SIGNIFICANCE, (
        f"means {first.mean():.6f} and {second.mean():.6f} differ: corrected p-value {least:.2g}"
    )
