"""Noise-aware squared errors: absolute, and relative with the formula in the name.

The reference is M independent batches R_i with mean R. The naive mean of ``(V - R)^2`` holds the
noise of R on top of the error of V. Products of *different* batches do not: their noises are
independent, so ``(V - R_i)(V - R_j)`` has the expectation ``(V - r)^2``, r being the true value.
All estimators here average such products over the pairs i != j; an estimate may be negative, which
says that the error is below the noise, and is never clamped.

The relative errors divide by ``r^2 + eps``. A denominator that shares noise with its numerator
gives a bias that does not vanish with the error, so each pair is divided by what the *other* M - 2
batches say, eps included. A test that equals the truth then has expectation exactly 0. What remains
is a factor on a true error, ``E[1 / (R^2 + eps)] (r^2 + eps)``, because the mean of a reciprocal
is not the reciprocal of the mean: 1 + O(relative variance of R). The jackknife removes its
leading order; ``tests/metrics/test_squared_error.py`` bounds the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.confidence import Estimate, estimate_from_leave_one_out, jackknife_of_distance
from metrics.images import Batches, Image, checked_batches, checked_inputs
from metrics.luminance import luminance
from metrics.measurement import Measurement

MSE_FORMULA = "mean over pixels, channels and pairs i != j of (V - R_i)(V - R_j)"
RELMSE_E2_FORMULA = (
    "mean over pixels, channels and pairs i != j of (V - R_i)(V - R_j) / (R^2 + eps), "
    "eps = 0.01 (mean luminance of R)^2, R the mean of the other batches"
)
RELMSE_E001_FORMULA = (
    "mean over pixels, channels and pairs i != j of (V - R_i)(V - R_j) / (R^2 + 0.01), "
    "R the mean of the other batches"
)
MRE_FORMULA = "mean over pixels and channels of |V - R| / (|R| + 0.1 mean(R))"

EXPOSURE_INVARIANT_SHARE = 0.01
"""eps of `relmse_e2` over the squared mean luminance of the reference."""
LITERAL_EPSILON = 0.01
"""eps of `relmse_e001`, in squared units of the image."""
MRE_SHARE = 0.1
"""Share of the mean reference in the denominator of `mean_relative_error`."""
LEAST_RELATIVE_BATCHES = 4
"""A pair, one batch left out by the jackknife, and one to divide by."""

_CHUNK = 4096
"""Values worked on at once: the products of all pairs of 8 batches then stay in a core's cache."""


def mse(test: ArrayLike, batches: ArrayLike, *, component: str = "image") -> Measurement:
    """Mean squared error without the reference's noise; negative where noise hides the error.

    Parameters
    ----------
    test
        Linear RGB, ``(H, W, 3)``.
    batches
        Independent references, ``(M, H, W, 3)``, M >= 2. The interval needs M >= 3.
    component
        Name of what is compared, for the record.

    Raises
    ------
    ValueError
        For illegal input.
    """
    checked_test, checked = checked_inputs(test, batches)
    errors = (checked_test - checked).reshape(len(checked), -1)
    products = errors @ errors.T / errors.shape[1]
    count = len(checked)
    value = _mean_of_pairs(products)
    if count == 2:
        return Measurement(
            name="mse",
            component=component,
            value=value,
            low=None,
            high=None,
            formula=MSE_FORMULA,
            unit="(W m^-2 sr^-1)^2",
            ideal=0.0,
            note="two batches make one pair, which has no interval",
        )
    keep = ~np.eye(count, dtype=bool)
    without_one = [_mean_of_pairs(products[np.ix_(rest, rest)]) for rest in keep]
    return Measurement.from_estimate(
        estimate_from_leave_one_out(value, np.array(without_one)),
        name="mse",
        component=component,
        formula=MSE_FORMULA,
        unit="(W m^-2 sr^-1)^2",
        ideal=0.0,
    )


def relmse_e2(test: ArrayLike, batches: ArrayLike, *, component: str = "image") -> Measurement:
    """Relative squared error that does not depend on exposure: eps follows the reference.

    Parameters
    ----------
    test
        Linear RGB, ``(H, W, 3)``.
    batches
        Independent references, ``(M, H, W, 3)``, M >= 4.
    component
        Name of what is compared, for the record.

    Raises
    ------
    ValueError
        For illegal input, or a reference with light in so few batches that an eps is 0.
    """
    checked_test, checked = checked_inputs(test, batches, least=LEAST_RELATIVE_BATCHES)
    estimate = _relative_pairs(
        checked, _error_products(checked_test), _epsilon_from_luminance(checked, component)
    )
    return Measurement.from_estimate(
        estimate, name="relmse_e2", component=component, formula=RELMSE_E2_FORMULA, ideal=0.0
    )


def relmse_e001(test: ArrayLike, batches: ArrayLike, *, component: str = "image") -> Measurement:
    """Relative squared error with the literal eps of 0.01, as tev has it; depends on exposure.

    Parameters
    ----------
    test
        Linear RGB, ``(H, W, 3)``.
    batches
        Independent references, ``(M, H, W, 3)``, M >= 4.
    component
        Name of what is compared, for the record.

    Raises
    ------
    ValueError
        For illegal input.
    """
    checked_test, checked = checked_inputs(test, batches, least=LEAST_RELATIVE_BATCHES)
    estimate = _relative_pairs(checked, _error_products(checked_test), lambda _: LITERAL_EPSILON)
    return Measurement.from_estimate(
        estimate, name="relmse_e001", component=component, formula=RELMSE_E001_FORMULA, ideal=0.0
    )


def reference_noise_relmse(batches: ArrayLike) -> Estimate:
    """Relative squared error of the mean of the batches itself: the noise floor of a comparison.

    ``mean of s^2 / M / (R^2 + eps)``, eps as in `relmse_e2`. The variance s^2 is averaged over
    pairs as ``(R_i - R_j)^2 / 2``, each divided by what the other batches say.

    Parameters
    ----------
    batches
        Independent references, ``(M, H, W, 3)``, M >= 4.

    Returns
    -------
    Estimate
        Pure number, with its interval.

    Raises
    ------
    ValueError
        For illegal input, or a reference with light in so few batches that an eps is 0.
    """
    checked = checked_batches(batches, least=LEAST_RELATIVE_BATCHES)
    one_batch = _relative_pairs(
        checked,
        lambda first, second, _: 0.5 * (first - second) ** 2,
        _epsilon_from_luminance(checked, "reference"),
    )
    count = len(checked)
    return Estimate(
        value=one_batch.value / count,
        low=one_batch.low / count,
        high=one_batch.high / count,
        level=one_batch.level,
    )


def mean_relative_error(
    test: ArrayLike, batches: ArrayLike, *, component: str = "image"
) -> Measurement:
    """Mean absolute error over reference, kept finite in the dark by a tenth of the mean.

    A distance, so noise of the reference adds to it; `metrics.confidence.jackknife_of_distance`
    says how value and interval treat that.

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
        For illegal input, or a reference without light in half of its batches.
    """
    checked_test, checked = checked_inputs(test, batches)

    def relative_error(image: Image, reference: Image) -> float:
        mean = float(reference.mean())
        if not mean > 0:
            raise _black_reference(component)
        return float((abs(image - reference) / (abs(reference) + MRE_SHARE * mean)).mean())

    return Measurement.from_estimate(
        jackknife_of_distance(relative_error, lambda image: image, checked_test, checked),
        name="mre",
        component=component,
        formula=MRE_FORMULA,
        ideal=0.0,
    )


_PairFunction = Callable[
    [NDArray[np.float64], NDArray[np.float64], NDArray[np.intp] | slice], NDArray[np.float64]
]
"""Numerator of two batches' values and where in the flat image these lie."""


def _error_products(test: Image) -> _PairFunction:
    flat = test.reshape(-1)
    return lambda first, second, where: (flat[where] - first) * (flat[where] - second)


def _mean_of_pairs(products: NDArray[np.float64]) -> float:
    count = len(products)
    return float((products.sum() - np.trace(products)) / (count * (count - 1)))


def _epsilon_from_luminance(batches: Batches, component: str) -> Callable[[list[int]], float]:
    batch_luminances = luminance(batches).mean(axis=(1, 2))

    def epsilon(others: list[int]) -> float:
        mean = float(batch_luminances[others].mean())
        if not mean > 0:
            raise _black_reference(component)
        return EXPOSURE_INVARIANT_SHARE * mean**2

    return epsilon


def _black_reference(component: str) -> ValueError:
    return ValueError(
        f"batches of component {component!r} must hold light in every one, some have none: a "
        "relative error to a black reference has no value, use an absolute metric such as mse."
    )


def _relative_pairs(
    batches: Batches, numerator: _PairFunction, epsilon: Callable[[list[int]], float]
) -> Estimate:
    """Jackknife of the mean over pairs of numerator / (R^2 + eps), R from the other batches.

    Without batch k, the pair (i, j) is divided by the batches other than i, j and k: the same
    reciprocal serves (i, j), (i, k) and (j, k), so one pass over the triples gives every
    leave-one-out value.
    """
    count = len(batches)
    flat = batches.reshape(count, -1)
    pairs = list(combinations(range(count), 2))
    triples = list(combinations(range(count), 3))
    everyone = range(count)
    epsilons = {
        dropped: epsilon([index for index in everyone if index not in dropped])
        for dropped in (*pairs, *triples)
    }
    full = 0.0
    without_one = np.zeros(count)
    for start in range(0, flat.shape[1], _CHUNK):
        where = slice(start, start + _CHUNK)
        values = flat[:, where]
        total = values.sum(axis=0)
        products = {(i, j): numerator(values[i], values[j], where) for i, j in pairs}
        for i, j in pairs:
            others = (total - values[i] - values[j]) / (count - 2)
            full += float(products[i, j] @ (1.0 / (others**2 + epsilons[i, j])))
        for i, j, k in triples:
            others = (total - values[i] - values[j] - values[k]) / (count - 3)
            weight = 1.0 / (others**2 + epsilons[i, j, k])
            without_one[k] += products[i, j] @ weight
            without_one[j] += products[i, k] @ weight
            without_one[i] += products[j, k] @ weight
    values_per_pair = flat.shape[1]
    pairs_without_one = (count - 1) * (count - 2) // 2
    return estimate_from_leave_one_out(
        full / (len(pairs) * values_per_pair), without_one / (pairs_without_one * values_per_pair)
    )
