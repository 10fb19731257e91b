"""Values for fields of a configuration, by dotted names such as `diffuse.aperture_scale`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, TypeVar, get_type_hints

from pydantic import TypeAdapter, ValidationError

from experiments.errors import InputError

Config = TypeVar("Config")
"""A frozen dataclass of scalars, tuples and other such dataclasses."""


def changed_config(base: Config, values: Mapping[str, Any]) -> Config:
    """Return a configuration with other values in some of its fields.

    Parameters
    ----------
    base
        A frozen dataclass, such as `vctgi.config.RenderConfig`.
    values
        By dotted name. A list stands for a tuple; a whole number does for a float.

    Raises
    ------
    InputError
        No such field, a value of another type, or one that the configuration refuses.
    """
    tree: dict[str, Any] = {}
    for name, value in values.items():
        *outer, last = name.split(".")
        inner = tree
        for word in outer:
            inner = inner.setdefault(word, {})
            if not isinstance(inner, dict):
                raise _no_single_value(name)
        if last in inner:
            raise _no_single_value(name)
        inner[last] = _Value(value)
    return _changed(base, tree, "")


@dataclass(frozen=True)
class _Value:
    """A leaf of the tree of changes, so that no value is taken for a branch."""

    given: Any


def _changed(base: Config, tree: Mapping[str, Any], before: str) -> Config:
    """Return `base` with some fields changed at once: its checks may look at several."""
    known = [each.name for each in fields(base)]  # type: ignore[arg-type]
    changes: dict[str, Any] = {}
    for word, change in tree.items():
        name = f"{before}{word}"
        if word not in known:
            raise InputError(
                what=f"a configuration has no field '{name}'",
                where="parameters",
                remedy=f"use one of {', '.join(before + each for each in known)}",
            )
        held = getattr(base, word)
        if is_dataclass(held) == isinstance(change, _Value):
            raise _no_single_value(name)
        if isinstance(change, _Value):
            changes[word] = _checked(change.given, get_type_hints(type(base))[word], name)
        else:
            changes[word] = _changed(held, change, f"{name}.")
    try:
        return replace(base, **changes)  # type: ignore[type-var]
    except ValueError as error:
        raise InputError(
            what=str(error).rstrip("."),
            where=", ".join(f"{before}{word}" for word in changes),
            remedy="give other values",
        ) from error


def _no_single_value(name: str) -> InputError:
    return InputError(
        what=f"'{name}' does not name one value",
        where="parameters",
        remedy="name a field that holds no fields, and each once",
    )


def _checked(value: Any, hint: Any, name: str) -> Any:
    """Return a value as its annotation wants it: exact types, but lists for tuples as in JSON."""
    try:
        return TypeAdapter(hint).validate_json(json.dumps(value), strict=True)
    except ValidationError as error:
        raise InputError(
            what=error.errors(include_url=False)[0]["msg"],
            where=f"{name} = {value!r}",
            remedy="give a value of the field's type",
        ) from error
