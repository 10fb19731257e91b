"""Attribution: which stage owns how much of the error, by putting exact stages in one at a time.

A renderer of n stages is run with 0, 1, ..., n of them exact, once from the first stage on and once
from the last; each step of either chain is what the stage owns. Where the two steps of one stage
differ, its share depends on what is exact already: that is the interaction, and it is reported, not
shared out. Each chain sums to the same total by construction; that nothing is left over at the end
of it, the error with everything exact, is the test.

Every picture comes in M independent renderings V_k, as the reference does in R_k. Squared errors
are averaged over pairs i != j of (V_i - R_i)(V_j - R_j), in which neither noise has a bias
(`metrics.squared_error`); what the noise of one rendering adds is a step of its own, the first.

References
----------
Noise-aware products: `metrics.squared_error`; jackknife: `metrics.confidence`. The two orders are
those of a two-sided ablation; their mean is the value of Shapley (1953) only for two stages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from metrics.confidence import Estimate, estimate_from_leave_one_out
from metrics.images import Batches, checked_batches

ErrorKind = Literal["energy", "relmse"]
"""What is attributed. "energy": mean(V) / mean(R) - 1; "relmse": mean of (V - R)^2 / (R^2 + eps),
eps = 0.01 mean(R)^2, without the noise of V and R."""

EPSILON_SHARE = 0.01
"""eps over the squared mean of the reference."""

LEAST_BATCHES = 5
"""A pair, one batch left out by the jackknife, and two to divide by."""


@dataclass(frozen=True, kw_only=True)
class StageError:
    """What one stage owns.

    Attributes
    ----------
    name
        The stage.
    forward
        By how much the error falls when it is made exact after those before it.
    backward
        The same after those behind it.
    interaction
        The first less the second: 0 where the stage owns the same whatever else is exact.
    """

    name: str
    forward: Estimate
    backward: Estimate
    interaction: Estimate


@dataclass(frozen=True, kw_only=True)
class Attribution:
    """The error of a renderer, by stages.

    Attributes
    ----------
    kind
        What was attributed.
    start
        Error of one rendering as it is.
    noise
        What of it the noise of one rendering owns; 0 for energy.
    stages
        What each stage owns, in the forward order.
    end
        Error with all stages exact: 0 within its interval, or the ledger does not close.
    interaction
        Sum of the stages' absolute interactions over two, which is what no order can share out.
    """

    kind: ErrorKind
    start: Estimate
    noise: Estimate
    stages: tuple[StageError, ...]
    end: Estimate
    interaction: float


def attribute_error(
    kind: ErrorKind,
    names: Sequence[str],
    forward: Sequence[ArrayLike],
    backward: Sequence[ArrayLike],
    reference: ArrayLike,
) -> Attribution:
    """Attribute the error of a renderer to its stages.

    Parameters
    ----------
    kind
        Which error.
    names
        The n stages, in the forward order.
    forward, backward
        n + 1 pictures each, ``(M, H, W, 3)`` linear RGB in M independent renderings: with the first
        0 .. n stages exact, and with the last 0 .. n. Both begin with the renderer as it is and end
        with all stages exact.
    reference
        ``(M, H, W, 3)``, M >= 5 independent references.

    Raises
    ------
    ValueError
        Counts or shapes that do not fit, numbers that are not finite, a black reference.
    """
    count = len(names)
    if count == 0 or len(forward) != count + 1 or len(backward) != count + 1:
        raise ValueError(
            f"attribute_error: {count} stages need {count + 1} pictures in each order, got "
            f"{len(forward)} and {len(backward)}."
        )
    truth = checked_batches(reference, least=LEAST_BATCHES)
    pictures = [_checked(each, truth) for each in (*forward, *backward)]
    errors = np.array(_leave_one_out(kind, pictures, truth))

    def combined(terms: dict[int, float]) -> Estimate:
        weights = np.zeros(errors.shape[1])
        for column, weight in terms.items():
            weights[column] += weight
        return estimate_from_leave_one_out(float(errors[0] @ weights), errors[1:] @ weights)

    # Columns: forward pictures, backward pictures, one rendering as it is.
    second, single = count + 1, 2 * (count + 1)
    stages = []
    for number, name in enumerate(names):
        # The stage is the (count - number)th to be made exact in the backward order.
        before = second + count - number - 1
        stages.append(
            StageError(
                name=name,
                forward=combined({number: 1.0, number + 1: -1.0}),
                backward=combined({before: 1.0, before + 1: -1.0}),
                interaction=combined(
                    {number: 1.0, number + 1: -1.0, before: -1.0, before + 1: 1.0}
                ),
            )
        )
    return Attribution(
        kind=kind,
        start=combined({single: 1.0}),
        noise=combined({single: 1.0, 0: -1.0}),
        stages=tuple(stages),
        end=combined({count: 1.0}),
        interaction=0.5 * sum(abs(stage.interaction.value) for stage in stages),
    )


def _checked(picture: ArrayLike, truth: Batches) -> Batches:
    checked = checked_batches(picture, least=LEAST_BATCHES)
    if checked.shape != truth.shape:
        raise ValueError(
            f"attribute_error: pictures and reference must have one shape, got {checked.shape} and "
            f"{truth.shape}: render as many batches of both."
        )
    return checked


def _leave_one_out(
    kind: ErrorKind, pictures: Sequence[Batches], truth: Batches
) -> list[list[float]]:
    """Errors of all pictures and of one rendering of the first: by all batches, then without each.

    Picture and reference lose the same batch, as if both were one experiment that is repeated.
    """
    everything = list(range(len(truth)))
    subsets = [everything, *([i for i in everything if i != out] for out in everything)]
    found = []
    for kept in subsets:
        held = truth[kept]
        if not held.mean() > 0.0:
            raise ValueError("attribute_error: the reference has no light, nothing is relative.")
        tests = [picture[kept] for picture in pictures]
        if kind == "energy":
            ratios = [float(test.mean() / held.mean()) - 1.0 for test in tests]
            found.append([*ratios, ratios[0]])
        else:
            scales = _scales(held)
            pairs = [_pairwise(test, held, scales) for test in tests]
            found.append([*pairs, _single(tests[0], held, scales)])
    return found


def _scales(held: Batches) -> dict[tuple[int, int], NDArray[np.float64]]:
    """Return what each pair of batches is divided by: R^2 + eps of all others."""
    total = held.sum(axis=0)
    scales = {}
    for i, j in combinations(range(len(held)), 2):
        others = (total - held[i] - held[j]) / (len(held) - 2)
        scales[i, j] = others**2 + EPSILON_SHARE * float(others.mean()) ** 2
    return scales


def _pairwise(
    test: Batches, held: Batches, scales: dict[tuple[int, int], NDArray[np.float64]]
) -> float:
    """Relative squared error of what the renderings are equal to in expectation."""
    error = test - held
    return float(np.mean([np.mean(error[i] * error[j] / s) for (i, j), s in scales.items()]))


def _single(
    test: Batches, held: Batches, scales: dict[tuple[int, int], NDArray[np.float64]]
) -> float:
    """Relative squared error of one rendering, mean over all of them."""
    # Mean over k of (V_k - R_i)(V_k - R_j), with the moments of V.
    mean, square = test.mean(axis=0), (test**2).mean(axis=0)
    terms = [
        np.mean((square - mean * (held[i] + held[j]) + held[i] * held[j]) / s)
        for (i, j), s in scales.items()
    ]
    return float(np.mean(terms))
