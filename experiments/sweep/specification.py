"""What a sweep file may say: scenes x presets x parameter values x seeds."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from experiments.errors import InputError

SMALLEST_PICTURE = 16
"""Shortest edge that every metric can measure, pixels; the same as for a report."""

SPP_STEP = 8
"""Reference samples come in multiples of this: independent batches."""


def _flat(value: object, before: str = "") -> object:
    """Return nested tables as one table of dotted names."""
    if not isinstance(value, dict):
        return value
    found: dict[str, object] = {}
    for key, inner in value.items():
        name = f"{before}.{key}" if before else str(key)
        if isinstance(inner, dict):
            nested = _flat(inner, name)
            assert isinstance(nested, dict)
            found |= nested
        else:
            found[name] = inner
    return found


Parameters = Annotated[dict[str, list[Any]], BeforeValidator(_flat)]
"""Values by dotted name; TOML's `a.b = [1, 2]` and `"a.b" = [1, 2]` are the same."""


class SweepSpec(BaseModel):
    """All of a sweep file."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    schema_version: Literal[1] = 1
    scenes: Annotated[list[str], Field(min_length=1)]
    """Each as the command line takes it: a built-in name or a path from the current folder."""
    presets: Annotated[list[str], Field(min_length=1)] = ["high"]
    parameters: Parameters = {}
    """Values of fields of the configuration; every combination of them is rendered."""
    seeds: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)] = [0]
    resolution: Annotated[int, Field(ge=SMALLEST_PICTURE)] | None = None
    """Longer edge of the pictures, pixels; left out: 256."""
    reference_spp: Annotated[int, Field(ge=SPP_STEP, multiple_of=SPP_STEP)] = 512
    """Paths a pixel of the reference."""
    variant: str | None = None
    """Back end; chosen by the machine if left out."""
    sensor: Annotated[int, Field(ge=0)] = 0
    """Which camera of each scene."""


def load_sweep(path: Path | None, given: dict[str, Any]) -> SweepSpec:
    """Read a sweep file, and let options of the command line take the place of its entries.

    Parameters
    ----------
    path
        A TOML file, or None where the options say everything.
    given
        Entries by name.

    Raises
    ------
    InputError
        The file is missing or no TOML, or an entry is unknown, missing or of the wrong type; the
        message names it.
    """
    content: dict[str, Any] = {}
    if path is not None:
        try:
            content = tomllib.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise InputError(
                f"cannot read the sweep file ({error.strerror})", str(path), "give the path of one"
            ) from error
        except ValueError as error:
            raise InputError(f"not TOML ({error})", str(path), "mend the line named") from error
    where = "the command line" if path is None else str(path)
    if path is None and "scenes" not in given:
        raise InputError("there is nothing to sweep", where, "give a sweep file or --scene")
    try:
        spec = SweepSpec.model_validate(content | given)
    except ValidationError as error:
        raise InputError(
            _first_fault(error), where, "see experiments/sweep/README.md for the keys"
        ) from error
    empty = [name for name, values in spec.parameters.items() if not values]
    if empty:
        raise InputError(f"the parameter '{empty[0]}' has no value", where, "give a list of some")
    return spec


def parse_set(words: list[str]) -> dict[str, list[Any]]:
    """Return the parameters that `--set NAME=VALUE,VALUE` names; values are written as in TOML.

    Raises
    ------
    InputError
        A word of another form.
    """
    found: dict[str, list[Any]] = {}
    for word in words:
        name, equals, text = word.partition("=")
        if not equals or not name.strip() or not text.strip():
            raise InputError(f"'{word}' is no parameter", "--set", "write NAME=VALUE,VALUE")
        found[name.strip()] = _values(text)
    return found


def _values(text: str) -> list[Any]:
    """Read `1,2` or `"maps","cones"`; what is no TOML, such as maps,cones, are words."""
    try:
        values: list[Any] = tomllib.loads(f"values = [{text}]")["values"]
    except tomllib.TOMLDecodeError:
        values = [word.strip() for word in text.split(",")]
    return values


def _first_fault(error: ValidationError) -> str:
    fault = error.errors(include_url=False)[0]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in fault["loc"])
    message = "unknown key" if fault["type"] == "extra_forbidden" else fault["msg"]
    others = error.error_count() - 1
    return f"{key.lstrip('.') or 'the file'}: {message}" + (f" (+{others} more)" if others else "")
