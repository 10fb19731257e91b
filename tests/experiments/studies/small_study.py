"""A study of four numbers that are known beforehand, and a count of how often each is measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np

from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.figures import Curve, Point

TITLE = "Do the numbers of a test come out?"

CURVE = Curve(group="numbers", title="Curve", caption="", x_label="first value", y_label="mean")

measured: Counter[str] = Counter()
"""How often each measurement was made; tests clear it."""


def _measurement(name: str, values: list[float]) -> Callable[[StudyContext], Measured]:
    def measure(context: StudyContext) -> Measured:
        measured[name] += 1
        context.progress("counting", 0.5)
        shared = context.once("shared", _shared)
        context.shelf.add_map("numbers", "Shared", np.full((2, 3), shared))
        return mean_of([shared * value for value in values[: 1 if context.quick else None]])

    return measure


def _shared() -> float:
    measured["shared"] += 1
    return 1.0


def _check(name: str, values: list[float], **limits: float) -> Check:
    return Check(
        name=name,
        configuration="plain numbers",
        scene="none",
        measure=_measurement(name, values),
        limit_low=limits.get("low"),
        limit_high=limits.get("high"),
        goal=limits.get("goal"),
        is_headline=name == "aim",
        points=(Point(CURVE, "all", values[0]),),
    )


def checks() -> list[Check]:
    """Return one check that passes, one that fails, one with a goal only, one without a value."""
    return [
        _check("mean", [1.0, 3.0], low=1.5),
        _check("mean, odd", [5.0], high=4.0),
        _check("aim", [0.5], goal=0.1),
        _check("broken", [float("nan")]),
    ]
