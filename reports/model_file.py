"""Reading the JSON file of a model, with one line that says what is wrong with it."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

Model = TypeVar("Model", bound=BaseModel)


def read_model(path: Path, model: type[Model], *, noun: str, kind: str, command: str) -> Model:
    """Read the JSON file of a model.

    Parameters
    ----------
    path
        The file.
    model
        What it holds.
    noun, kind
        What messages call it, and what it is the record of.
    command
        What to type to make it.

    Raises
    ------
    ValueError
        When the file is missing or holds something else.
    """
    try:
        return model.model_validate_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{path}: cannot read the {noun} ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: not UTF-8 text at byte {error.start}; make it again") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or noun
        raise ValueError(
            f"{path}: not the record of a {kind}, at {where}: {first['msg']}; make it again with "
            f"`{command}`"
        ) from error
