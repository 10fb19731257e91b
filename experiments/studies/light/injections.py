"""The ways to inject light that are compared, and the rows of their checks."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypedDict, Unpack

from experiments.studies.check import Check, Measured, StudyContext
from vctgi.stages.light_injection import LightInjectionConfig

INJECTIONS = {
    "scatter": LightInjectionConfig(),
    "gather": LightInjectionConfig(algorithm="gather"),
    "centre": LightInjectionConfig(algorithm="centre"),
    "scatter 3 wide": LightInjectionConfig(prefilter=3),
    "gather 3 wide": LightInjectionConfig(algorithm="gather", prefilter=3),
    "scatter 5 wide": LightInjectionConfig(prefilter=5),
    "scatter bounded": LightInjectionConfig(normalisation="radiance"),
    "scatter 3 wide bounded": LightInjectionConfig(prefilter=3, normalisation="radiance"),
}
"""Ways to inject light, by name."""

COMPARED = ("scatter", "scatter 3 wide", "scatter 5 wide", "scatter bounded", "centre")
"""Those of which each does something of its own."""

PLACEMENTS = {"axis": False, "turned": True}
"""Whether the scene is turned obliquely to the voxels."""


class Limits(TypedDict, total=False):
    """What a number must keep to, if anything."""

    limit_low: float
    limit_high: float


def row(
    name: str,
    how: str,
    scene: str,
    measure: Callable[[StudyContext], Measured],
    *,
    in_quick: bool = True,
    **limits: Unpack[Limits],
) -> Check:
    """Return the check of one number of one way to inject light."""
    return Check(
        name=f"{name}, {how}",
        configuration=how,
        scene=scene,
        measure=measure,
        in_quick=in_quick,
        **limits,
    )
