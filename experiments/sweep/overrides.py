"""Values for fields of a configuration, by dotted names such as `diffuse.aperture_scale`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
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
    for name, value in values.items():
        base = _changed(base, name.split("."), value, name)
    return base


def _changed(base: Config, path: list[str], value: Any, name: str) -> Config:
    """Return `base` with one field changed, which may lie deeper."""
    known = [each.name for each in fields(base)]  # type: ignore[arg-type]
    if path[0] not in known:
        raise InputError(
            what=f"a configuration has no field '{name}'",
            where="parameters",
            remedy=f"at '{path[0]}', use one of {', '.join(known)}",
        )
    held = getattr(base, path[0])
    if len(path) > 1 and is_dataclass(held) and not isinstance(held, type):
        changed: Any = _changed(held, path[1:], value, name)
    elif len(path) == 1 and not is_dataclass(held):
        changed = _checked(value, get_type_hints(type(base))[path[0]], name)
    else:
        raise InputError(
            what=f"'{name}' does not name a single value",
            where="parameters",
            remedy=f"name a field of '{path[0]}'" if len(path) == 1 else f"stop at '{path[0]}'",
        )
    try:
        return replace(base, **{path[0]: changed})  # type: ignore[type-var]
    except ValueError as error:
        raise InputError(str(error).rstrip("."), f"{name} = {value!r}", "change it") from error


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
