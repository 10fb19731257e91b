"""Whether a scene changed since an earlier frame: its parameters, compared without reading them.

An array that nobody wrote to is the same variable of Dr.Jit's, so large ones are compared by its
number; the state holds them, so no other array can be given the number meanwhile. Small ones are
compared by value. A scene may count as changed that is not, never the other way round: what Mitsuba
does not expose as a parameter cannot be changed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

COMPARED_BY_VALUE = 64
"""Numbers of a parameter up to which they are compared themselves."""


Parameters = dict[str, object]
"""What `mi.traverse` finds, by name, as it was."""


@dataclass(frozen=True)
class SceneState:
    """The parameters of a scene and of its camera as they were.

    Attributes
    ----------
    scene, sensor
        Whose they are.
    parameters
        By name.
    """

    scene: mi.Scene
    sensor: mi.Sensor
    parameters: Parameters

    def is_same(self, other: SceneState) -> bool:
        """Whether nothing changed from one state to the other."""
        return (
            self.scene == other.scene
            and self.sensor == other.sensor
            and are_same(self.parameters, other.parameters)
        )


def scene_state(scene: mi.Scene, sensor: mi.Sensor) -> SceneState:
    """Return the parameters of a scene and a camera, which need not be one of the scene's own."""
    watched = WatchedParameters({"scene": scene, "sensor": sensor})
    return SceneState(scene, sensor, watched.read())


class WatchedParameters:
    """The parameters of parts of a scene, listed once, and read as often as they may have changed.

    To list the parameters of many shapes takes the host longer than a frame may take; to read them
    does not. The parts must keep their own parts: a texture that is replaced by another object is
    not seen.

    Parameters
    ----------
    parts
        By name.
    """

    def __init__(self, parts: Mapping[str, mi.Object]) -> None:
        self._listed: dict[str, Any] = {name: mi.traverse(part) for name, part in parts.items()}

    def read(self) -> Parameters:
        """Return the parameters as they are now."""
        return {
            f"{part}.{name}": _own(listed[name])
            for part, listed in self._listed.items()
            for name in listed.properties
        }


def watched_surfaces(scene: mi.Scene) -> WatchedParameters:
    """Return the parameters of all shapes, with their BSDFs and lamps."""
    return WatchedParameters({str(number): each for number, each in enumerate(scene.shapes())})


def are_same(first: Parameters, second: Parameters, *, reads_small: bool = True) -> bool:
    """Whether nothing changed from one to the other.

    Parameters
    ----------
    first, second
        What to compare.
    reads_small
        Whether the host reads small arrays that were written to, which may hold what they did.
    """
    limit = COMPARED_BY_VALUE if reads_small else 0
    return first.keys() == second.keys() and all(
        _is_same(held, second[name], limit) for name, held in first.items()
    )


def _own(held: Any) -> object:
    """Return a parameter as it is now: what Mitsuba hands out changes with the scene.

    The copy of an array is another name of the same variable, until one of the two is written to.
    """
    # A transformation is its matrix, which the host need not read.
    matrix = getattr(held, "matrix", held)
    return type(matrix)(matrix) if dr.is_jit_v(matrix) else _copied(held)


def _copied(held: object) -> object:
    """Return the numbers of a parameter, or what is neither number nor array as it is."""
    values = np.array(getattr(held, "matrix", held))
    return held if values.dtype == object else values


def _is_same(first: object, second: object, limit: int) -> bool:
    if dr.is_jit_v(first) and dr.is_jit_v(second):
        if dr.grad_enabled(first, second) or dr.width(first) != dr.width(second):
            return False
        if _variables(first) == _variables(second):
            return True
        if dr.width(first) > limit:
            return False
        first, second = _copied(first), _copied(second)
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return np.array_equal(first, second)
    return type(first) is type(second) and bool(first == second)


def _variables(held: Any) -> list[int]:
    """Numbers of Dr.Jit's variables that an array consists of."""
    if dr.is_tensor_v(held):
        held = held.array
    if dr.depth_v(held) > 1:
        return [number for part in held for number in _variables(part)]
    return [int(held.index)]
