"""From names on the command line to parameters of a configuration."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.errors import InputError
from experiments.optimize.parameters import CHOICES, SINGLE, Parameter
from experiments.optimize.ring_parameters import RINGS, ring_parameters
from vctgi.config import RenderConfig


def parameter_names() -> list[str]:
    """Return all names that `find_parameters` takes."""
    return [*SINGLE, *RINGS, *CHOICES]


def find_parameters(names: Sequence[str], config: RenderConfig) -> list[Parameter]:
    """Return the parameters that are named, one for each ring where a name means rings.

    Raises
    ------
    InputError
        A name that does not exist or does not fit the configuration or another name.
    """
    found: list[Parameter] = []
    for name in dict.fromkeys(names):
        if name in SINGLE or name in CHOICES:
            found.append(_fitting({**SINGLE, **CHOICES}[name], config))
        elif name in RINGS:
            found += [_fitting(each, config) for each in ring_parameters(name, config)]
        else:
            raise InputError(
                what=f"there is no parameter '{name}'",
                where="--parameters",
                remedy=f"use {', '.join(parameter_names())}",
            )
    if not found:
        raise InputError(what="no parameter is named", where="--parameters", remedy="name one")
    if "cone_count" in names and any(name in RINGS for name in names):
        raise InputError(
            what="another number of cones has other rings",
            where="--parameters",
            remedy="fit cone_count first, and the rings from the preset file that comes of it",
        )
    # A count resets what is set cone by cone, so choices are written first.
    return sorted(found, key=lambda each: each.options is None)


def _fitting(parameter: Parameter, config: RenderConfig) -> Parameter:
    """Return a parameter whose start lies in its bounds, or refuse it."""
    value = parameter.read(config)
    is_option = parameter.options is None or value in parameter.options
    if not (parameter.low <= value <= parameter.high and is_option):
        raise InputError(
            what=f"'{parameter.name}' is {value:g} in the preset, outside of "
            f"{parameter.low:g} .. {parameter.high:g} ({parameter.reason})",
            where="--parameters",
            remedy="leave it out, or start from another preset",
        )
    return parameter
