"""Refusing to judge a record whose reference is too noisy for the differences asked about."""

from __future__ import annotations

import math
from typing import Final

from experiments.errors import MachineryError
from experiments.gate.finding import Finding
from experiments.gate.specification import Absolute, GateSpec, NonInferior
from reports.record import Record

LEAST_FACTOR: Final = 10.0
"""How far the noise floor must lie below the smallest difference, as `reference.noise` has it."""
DIFFERENCE: Final = "relmse_e2"
"""The metric that is of the same kind as the noise."""


def check_noise(record: Record, gate: GateSpec) -> Finding | None:
    """Refuse a noisy reference, for each component with a gate of an error or a ratio.

    Whether an interval is narrow enough for its tolerance is another matter, which each metric's
    gate decides.

    Returns
    -------
    Finding or None
        Passed, with the smallest ratio of difference to noise; None where no component that is
        gated has a relative difference, as in the dark.

    Raises
    ------
    MachineryError
        The noise is not ten times below the smallest difference, or the record does not tell.
    """
    differences = {m.component: m.value for m in record.metrics if m.name == DIFFERENCE}
    least = math.inf
    # Gates of other kinds ask whether anything moved, and say themselves what noise lets them see.
    compared = [each for each in gate.metrics if isinstance(each, Absolute | NonInferior)]
    for component in dict.fromkeys(each.component for each in compared):
        if component not in differences or record.reference is None:
            continue
        where = f"{component} of gate {gate.name}"
        floor = record.reference.noise_floors.get(component)
        if floor is None:
            raise MachineryError(
                "the record does not say how noisy its reference is", where, "render it again"
            )
        difference = gate.smallest_difference or differences[component]
        if floor.upper * LEAST_FACTOR > difference:
            share = LEAST_FACTOR * floor.upper / max(difference, floor.upper)
            spp = math.ceil(record.reference.samples_per_pixel * share)
            raise MachineryError(
                f"the reference is too noisy to compare: its noise relMSE of at most "
                f"{floor.upper:.2g} is not {LEAST_FACTOR:g} times below {difference:.2g}, the "
                "smallest difference asked about",
                where,
                f"set reference_spp to at least {spp}",
            )
        least = min(least, difference / floor.upper)
    if math.isinf(least):
        return None
    return Finding(
        kind="noise",
        passed=True,
        value=least,
        limit=f"noise {LEAST_FACTOR:g} times below the smallest difference",
        message=f"{least:.3g} times below",
    )
