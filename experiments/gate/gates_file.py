"""All of `gates.toml`: the gates of scenes and of studies, and how the file is read."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError, model_validator

from experiments.errors import InputError
from experiments.gate.specification import GateSpec, Order, Settings
from experiments.gate.study_specification import StudyGate


class GatesFile(Settings):
    """All of `gates.toml`."""

    schema_version: Literal[1]
    baselines: str = "."
    """Folder of the baseline files, relative to the gates file."""
    gates: tuple[GateSpec, ...] = Field(alias="gate", default=(), strict=False)
    orders: tuple[Order, ...] = Field(alias="order", default=(), strict=False)
    studies: tuple[StudyGate, ...] = Field(alias="study", default=(), strict=False)

    @model_validator(mode="after")
    def _names_are_unique_and_known(self) -> GatesFile:
        names = [gate.name for gate in self.gates]
        everything = names + [order.name for order in self.orders]
        everything += [study.name for study in self.studies]
        if not self.gates and not self.studies:
            raise ValueError("there is no [[gate]] and no [[study]]")
        repeated = {name for name in everything if everything.count(name) > 1}
        if repeated:
            raise ValueError(f"the name {min(repeated)!r} is given more than once")
        for order in self.orders:
            unknown = {order.better, order.worse} - set(names)
            if unknown or order.better == order.worse:
                raise ValueError(
                    f"order {order.name!r} must name two different gates of {sorted(names)}, got "
                    f"better {order.better!r}, worse {order.worse!r}"
                )
        return self

    def only(self, names: Sequence[str]) -> GatesFile:
        """Return the gates and studies of these names, and the orders between those.

        Raises
        ------
        InputError
            None has a name.
        """
        known = [gate.name for gate in self.gates] + [study.name for study in self.studies]
        for name in names:
            if name not in known:
                raise InputError(f"no gate '{name}'", "--only", f"use {', '.join(known)}")
        orders = [each for each in self.orders if {each.better, each.worse} <= set(names)]
        return self.model_copy(
            update={
                "gates": tuple(each for each in self.gates if each.name in names),
                "studies": tuple(each for each in self.studies if each.name in names),
                "orders": tuple(orders),
            }
        )


def load_gates(path: Path) -> GatesFile:
    """Read and check a `gates.toml`.

    Raises
    ------
    InputError
        When the file is missing, is not TOML, or has an unknown key, a wrong type, a tolerance
        wider than its mutant or a name twice; the message names the key.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f"cannot read the gates file ({error.strerror})", str(path), "give the path of one"
        ) from error
    except ValueError as error:
        raise InputError(f"not TOML ({error})", str(path), "mend the line named") from error
    try:
        return GatesFile.model_validate(content)
    except ValidationError as error:
        raise InputError(
            _first_fault(error), str(path), "see experiments/gate/README.md for the keys"
        ) from error


def _first_fault(error: ValidationError) -> str:
    fault = error.errors(include_url=False)[0]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in fault["loc"])
    message = "unknown key" if fault["type"] == "extra_forbidden" else fault["msg"]
    others = error.error_count() - 1
    return f"{key.lstrip('.') or 'the file'}: {message}" + (f" (+{others} more)" if others else "")
