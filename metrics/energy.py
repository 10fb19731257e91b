"""Energy ratio: whether the test holds as much light as the reference."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from metrics.confidence import estimate_from_leave_one_out
from metrics.images import checked_inputs
from metrics.measurement import Measurement

ENERGY_RATIO_FORMULA = "mean(V) / mean(R), means over pixels and channels"


def energy_ratio(test: ArrayLike, batches: ArrayLike, *, component: str = "image") -> Measurement:
    """Mean of the test over mean of the reference; 1 where no energy is gained or lost.

    Parameters
    ----------
    test
        Linear RGB, ``(H, W, 3)``.
    batches
        Independent references, ``(M, H, W, 3)``, M >= 2.
    component
        Name of what is compared, for the record.

    Raises
    ------
    ValueError
        For illegal input, or a reference without light: the ratio has no value there.
    """
    checked_test, checked = checked_inputs(test, batches)
    batch_means = checked.mean(axis=(1, 2, 3))
    count = len(batch_means)
    means_without_one = (batch_means.sum() - batch_means) / (count - 1)
    if not (means_without_one > 0).all():
        raise ValueError(
            f"batches of component {component!r} must hold light in at least two of them, got "
            f"batch means {np.array2string(batch_means, precision=3)}: a ratio to a black "
            "reference has no value, use an absolute metric such as mse."
        )
    test_mean = float(checked_test.mean())
    estimate = estimate_from_leave_one_out(
        test_mean / float(batch_means.mean()), test_mean / means_without_one
    )
    return Measurement.from_estimate(
        estimate,
        name="energy_ratio",
        component=component,
        formula=ENERGY_RATIO_FORMULA,
        ideal=1.0,
    )
