"""Evaluation at the end of a stage that the derivatives of the stage take part in.

`dr.eval` computes values and leaves their derivatives to one kernel at the end, which holds every
stage of every sample at once: half a minute of compilation at four samples a pixel, minutes on a
GPU. A boundary is an operation that changes nothing, and evaluates derivatives as they pass it in
either direction; so their kernels are about as large as those of the values.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, TypeVar, cast

import drjit as dr

Value = TypeVar("Value")


def evaluated(value: Value) -> Value:
    """Evaluate arrays now, and their derivatives once they come by.

    Parameters
    ----------
    value
        An array, a tensor, a dataclass, a list or a dictionary of such.

    Returns
    -------
    Value
        The same. What has derivatives is new, and is to be used in place of what was given.
    """
    dr.eval(value)
    return with_boundary(value)


def with_boundary(value: Value) -> Value:
    """Evaluate the derivatives of arrays once they come by, as `evaluated`, and nothing now."""
    leaves = list(_leaves(value))
    if not leaves:
        return value
    passed: list[Any] = dr.custom(_Boundary, leaves)
    return cast("Value", _rebuilt(value, iter(passed)))


def accompanied(value: Value, companion: object, beside: Sequence[Any] = ()) -> Value:
    """Keep an object alive until derivatives of arrays have gone by; nothing is evaluated.

    Parameters
    ----------
    value
        As for `evaluated`.
    companion
        What the operations that led to it need while they are differentiated.
    beside
        Arrays that derivatives are to pass, too, on their way to `value`, which does not follow
        from them.
    """
    leaves = list(_leaves(value))
    if not leaves:
        return value
    passed: list[Any] = dr.custom(_Accompanied, leaves, list(beside), [companion])
    return cast("Value", _rebuilt(value, iter(passed)))


class _Boundary(dr.CustomOp):
    """Nothing, but that derivatives are evaluated on their way through it."""

    def eval(self, leaves: list[Any]) -> list[Any]:
        return [type(leaf)(leaf) for leaf in leaves]

    def forward(self) -> None:
        tangents: Any = self.grad_in("leaves")
        dr.eval(tangents)
        self.set_grad_out(tangents)

    def backward(self) -> None:
        adjoints: Any = self.grad_out()
        dr.eval(adjoints)
        self.set_grad_in("leaves", adjoints)

    def name(self) -> str:
        return "evaluated"


class _Accompanied(dr.CustomOp):
    """Nothing, but that an object lives as long as this operation."""

    def eval(self, leaves: list[Any], _beside: list[Any], companions: list[object]) -> list[Any]:
        self.companions = companions
        return [type(leaf)(leaf) for leaf in leaves]

    def forward(self) -> None:
        self.set_grad_out(self.grad_in("leaves"))

    def backward(self) -> None:
        self.set_grad_in("leaves", self.grad_out())

    def name(self) -> str:
        return "accompanied"


def _parts(value: Any) -> dict[Any, Any]:
    """Return what a value is made of, by name; nothing for a flat array and what is no array."""
    if value is None:
        return {}
    if dr.is_tensor_v(value):
        return {"array": value.array}
    if dr.is_array_v(value):
        return dict(enumerate(value)) if dr.depth_v(value) > 1 else {}
    if isinstance(value, dict):
        return value
    if isinstance(value, list | tuple):
        return dict(enumerate(value))
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value)}
    return {}


def _leaves(value: Any) -> Iterator[Any]:
    """Yield the flat arrays that have derivatives."""
    parts = _parts(value)
    if not parts and value is not None and dr.is_array_v(value) and dr.grad_enabled(value):
        yield value
    for part in parts.values():
        yield from _leaves(part)


def _rebuilt(value: Any, leaves: Iterator[Any]) -> Any:
    """Return a value with other flat arrays in place of those that have derivatives."""
    if not dr.grad_enabled(value):
        return value
    parts = {name: _rebuilt(part, leaves) for name, part in _parts(value).items()}
    if not parts:
        return next(leaves)
    if dr.is_tensor_v(value):
        return type(value)(parts["array"], value.shape)
    if dr.is_array_v(value):
        return type(value)(*parts.values())
    if isinstance(value, dict):
        return parts
    if isinstance(value, list | tuple):
        return type(value)(parts.values())
    return replace(value, **parts)
