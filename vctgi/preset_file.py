"""Preset files: what a configuration changes of a named one, and how it was made, as TOML.

```toml
format = 1
base = "high"
unset = []                       # dotted names of what is None here

[config.diffuse]
aperture_scale = 1.12

[record]
command = "vctgi optimize small_light --held-out cornell_box"
```

Nothing here knows a configuration by name: values are checked against the annotations of the
dataclass that they go into, and by its own checks.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
import tomllib
import types
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from vctgi.errors import PresetFileError

SUFFIX = ".toml"
"""How the name of a preset file ends."""

FORMAT = 1
"""Version of the layout of these files."""

KEYS = ("format", "base", "unset", "config", "record")
"""What stands at the top of a file."""

Config = TypeVar("Config")
"""A frozen dataclass of scalars, tuples and other such dataclasses."""


@dataclass(frozen=True, kw_only=True)
class PresetFile:
    """What a file says, unchecked against any configuration."""

    base: str
    """The named preset that it changes."""
    changes: dict[str, Any]
    """Values by field, nested as the configuration is."""
    unset: tuple[str, ...] = ()
    """Dotted names of fields that are None here and something else in the base."""
    record: dict[str, Any] = field(default_factory=dict)
    """How the file was made: command, scenes, seeds, numbers before and after."""


def is_preset_file(name: str) -> bool:
    """Whether the name of a preset is that of a file."""
    return name.endswith(SUFFIX)


def read_preset_file(path: str | Path) -> PresetFile:
    """Read a file.

    Raises
    ------
    PresetFileError
        It cannot be read, is not TOML, or has another layout.
    """
    where = str(path)
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise PresetFileError(
            f"the preset file cannot be read ({error.strerror})", where, "correct its path"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise PresetFileError(
            f"the preset file is not TOML ({error})", where, "mend it, or make it again"
        ) from error
    unknown = [key for key in content if key not in KEYS]
    if unknown:
        raise PresetFileError(
            f"the preset file has no key '{unknown[0]}'", where, f"use {', '.join(KEYS)}"
        )
    if content.get("format") != FORMAT:
        raise PresetFileError(
            f"the preset file's format is {content.get('format')!r}", where, f"write {FORMAT}"
        )
    shapes: tuple[tuple[str, type, object], ...] = (
        ("base", str, None),
        ("unset", list, []),
        ("config", dict, {}),
        ("record", dict, {}),
    )
    for key, kind, default in shapes:
        if not isinstance(content.setdefault(key, default), kind):
            raise PresetFileError(
                f"the preset file's key '{key}' is missing or not a {kind.__name__}",
                where,
                f"see the example of {__name__}",
            )
    return PresetFile(
        base=content["base"],
        changes=content["config"],
        unset=tuple(map(str, content["unset"])),
        record=content["record"],
    )


def changed_config(base: Config, file: PresetFile, where: str | Path) -> Config:
    """Return a configuration with a file's changes.

    Parameters
    ----------
    base
        Configuration of the preset that the file names.
    file
        What it changes.
    where
        The file, for errors.

    Raises
    ------
    PresetFileError
        A field that does not exist, a value of another type, or one that the configuration refuses.
    """
    changes = _deep_copy(file.changes)
    for name in file.unset:
        _put(changes, name.split("."), None, where)
    return _changed(base, changes, "config", str(where))


def config_changes(base: Config, config: Config) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return what a configuration changes: values by field, and dotted names of what is None."""
    changes: dict[str, Any] = {}
    unset: list[str] = []
    for each in fields(base):  # type: ignore[arg-type]
        before, after = getattr(base, each.name), getattr(config, each.name)
        if is_dataclass(before) and type(before) is type(after):
            inner, inner_unset = config_changes(before, after)
            if inner:
                changes[each.name] = inner
            unset += [f"{each.name}.{name}" for name in inner_unset]
        elif before != after:
            if after is None:
                unset.append(each.name)
            else:
                changes[each.name] = after
    return changes, tuple(unset)


def write_preset_file(path: Path, file: PresetFile) -> None:
    """Write a file, whole or not at all; reading it gives equal values back, to the last bit."""
    lines = [
        f"format = {FORMAT}",
        f"base = {_value(file.base)}",
        f"unset = {_value(file.unset)}",
        *_table(("config",), file.changes),
        *_table(("record",), file.record),
    ]
    text = "\n".join(lines) + "\n"
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        Path(name).chmod(0o644)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _changed(base: Config, changes: Mapping[str, Any], name: str, where: str) -> Config:
    """Return a dataclass with values that were checked against its annotations."""
    hints = get_type_hints(type(base))
    values = {}
    for key, given in changes.items():
        place = f"{name}.{key}"
        if key not in {each.name for each in fields(base)}:  # type: ignore[arg-type]
            known = ", ".join(each.name for each in fields(base))  # type: ignore[arg-type]
            raise PresetFileError(f"there is no field '{place}'", where, f"use one of {known}")
        held = getattr(base, key)
        if is_dataclass(held) and isinstance(given, dict):
            values[key] = _changed(held, given, place, where)
        else:
            values[key] = _checked(given, hints[key], place, where)
    try:
        return replace(base, **values)  # type: ignore[type-var]
    except ValueError as error:
        raise PresetFileError(str(error).rstrip("."), where, f"change '{name}'") from error


def _checked(given: Any, hint: Any, place: str, where: str) -> Any:
    """Return a value as its annotation asks for it."""
    for kind in get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,):
        found = _as_kind(given, kind)
        if found is not _OTHER:
            return found
    wanted = getattr(hint, "__name__", None) if isinstance(hint, type) else None
    raise PresetFileError(
        f"'{place}' is {given!r}, a {type(given).__name__}",
        where,
        f"give {wanted or str(hint).replace('typing.', '')}",
    )


_OTHER = object()
"""What `_as_kind` returns for a value of another kind."""


def _as_kind(given: Any, kind: Any) -> Any:
    """Return a value as an annotation without alternatives asks for it, or `_OTHER`."""
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Literal:
        return (
            given
            if any(given == each and type(given) is type(each) for each in arguments)
            else _OTHER
        )
    if origin is tuple:
        return _as_tuple(given, arguments)
    if kind is float and type(given) is int:
        return float(given)
    if kind is type(None):
        return None if given is None else _OTHER
    return given if type(given) is kind else _OTHER


def _as_tuple(given: Any, kinds: tuple[Any, ...]) -> Any:
    if not isinstance(given, list | tuple):
        return _OTHER
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        kinds = (kinds[0],) * len(given)
    if len(kinds) != len(given):
        return _OTHER
    found = tuple(_as_kind(each, kind) for each, kind in zip(given, kinds, strict=True))
    return _OTHER if any(each is _OTHER for each in found) else found


def _put(changes: dict[str, Any], names: list[str], value: object, where: str | Path) -> None:
    """Put a value at a nested place."""
    for name in names[:-1]:
        changes = changes.setdefault(name, {})
        if not isinstance(changes, dict):
            raise PresetFileError(
                f"'{'.'.join(names)}' of 'unset' is no field", str(where), "correct its name"
            )
    changes[names[-1]] = value


def _deep_copy(changes: dict[str, Any]) -> dict[str, Any]:
    return {
        key: _deep_copy(value) if isinstance(value, dict) else value
        for key, value in changes.items()
    }


def _table(names: tuple[str, ...], values: Mapping[str, Any]) -> list[str]:
    """Return a table as lines: its own values, then the tables in it."""
    inner = {key: value for key, value in values.items() if isinstance(value, Mapping)}
    own = {key: value for key, value in values.items() if key not in inner}
    lines = ["", f"[{'.'.join(map(_key, names))}]"] if own or not inner else []
    lines += [f"{_key(key)} = {_value(value)}" for key, value in own.items()]
    for key, value in inner.items():
        lines += _table((*names, key), value)
    return lines


def _key(name: str) -> str:
    """Return a key, in quotes where TOML wants them."""
    is_bare = name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    return name if is_bare else _value(name)


def _value(value: Any) -> str:
    """Return a scalar or an array as TOML."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return "nan" if math.isnan(value) else repr(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    raise TypeError(f"{type(value).__name__} has no place in a preset file: {value!r}.")
