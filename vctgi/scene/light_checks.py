"""Refusing emitters that cannot shine, before anything is rendered."""

from __future__ import annotations

import mitsuba as mi
import numpy as np

from vctgi.errors import SceneError
from vctgi.scene.lights import Light

VALUE_NAMES = ("value", "data", "scale", "sun_scale", "sky_scale")
"""Last parts of the names of parameters that an emitter's power is a multiple of."""


def check_lights(lights: list[Light]) -> None:
    """Refuse emitters whose parameters give them no sensible power.

    Raises
    ------
    SceneError
        Values or pixels that are negative, infinite or NaN; a spot without an angle; a lamp
        without an area. It names the emitter.
    """
    for light in lights:
        _check_values(light)
        if light.kind == "SpotLight":
            _check_angle(light)
        shape = light.emitter.get_shape()
        if shape is not None:
            _check_area(light, shape)


def _check_values(light: Light) -> None:
    parameters = mi.traverse(light.emitter)
    for name, held in parameters.items():  # type: ignore[no-untyped-call]
        if name.rsplit(".", 1)[-1] not in VALUE_NAMES:
            continue
        values = np.array(held, dtype=np.float64)
        sick = int(np.count_nonzero(~(np.isfinite(values) & (values >= 0.0))))
        if sick:
            raise SceneError(
                f"{sick} of {values.size} values of its '{name}' are negative, infinite or NaN",
                f"emitter '{light.name}'",
                "give it values that are finite and at least 0",
            )


def _check_angle(light: Light) -> None:
    angle = float(np.array(mi.traverse(light.emitter)["cutoff_angle"]).ravel()[0])
    if not angle > 0.0:
        raise SceneError(
            f"its cone has no angle, cutoff_angle = {angle:g}",
            f"emitter '{light.name}'",
            "give it a cutoff_angle above 0 degrees",
        )


def _check_area(light: Light, shape: mi.Shape) -> None:
    area = float(np.array(shape.surface_area()).ravel()[0])
    if not (area > 0.0 and np.isfinite(area)):
        raise SceneError(
            f"its shape has no area that light could leave from ({area:g})",
            f"emitter '{light.name}'",
            "enlarge the shape, or take the emitter off it",
        )
