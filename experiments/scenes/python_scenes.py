"""Scenes that are Python functions: running a user's file, and turning text into arguments."""

from __future__ import annotations

import importlib.util
import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import mitsuba as mi

from experiments.errors import InputError
from experiments.scenes.catalogue import describe
from experiments.scenes.mitsuba_errors import input_error


def load_python_scene(path: Path, parameters: dict[str, str]) -> tuple[Any, str]:
    """Run a `.py` scene file and load the dict that its `scene()` returns.

    File names in the dict are looked for beside the scene file first.

    Returns
    -------
    tuple
        What `mi.load_dict` made of it, and the prose of the docstring of function or module.

    Raises
    ------
    InputError
        Whatever the user's file raises or lacks.
    """
    source = str(path)
    module = _run(path)
    function = getattr(module, "scene", None)
    if not callable(function):
        raise InputError(
            what="the file has no function scene()",
            where=source,
            remedy="define scene() and let it return a Mitsuba dict",
        )
    with _files_beside(path):
        made = call_scene_function(function, parameters, source)
        if not isinstance(made, dict):
            raise InputError(
                what=f"scene() returned {type(made).__name__}, not a dict",
                where=source,
                remedy="return a dict in the form that mi.load_dict takes",
            )
        loaded = load_scene_dict(made, source)
    summary = " ".join((module.__doc__ or "").strip().partition("\n\n")[0].split())
    return loaded, describe(function) or summary


def _run(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"scene_file_{path.stem}", path)
    assert spec is not None, "a .py path always has a loader"
    assert spec.loader is not None, "a .py path always has a loader"
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise _python_error(error, "the scene file cannot be run", str(path)) from error
    return module


def call_scene_function(
    function: Callable[..., Any], parameters: dict[str, str], source: str
) -> Any:
    """Call a scene function with text turned into the types of its defaults.

    Raises
    ------
    InputError
        For a parameter that the function does not have, a text that is no value of it, or when the
        function itself raises.
    """
    known = inspect.signature(function).parameters
    arguments: dict[str, Any] = {}
    for name, text in parameters.items():
        if name not in known:
            raise InputError(
                what=f"the scene has no parameter {name}",
                where=source,
                remedy=f"use one of: {', '.join(known) or 'none'}",
            )
        arguments[name] = _parse(name, text, known[name].default, source)
    try:
        return function(**arguments)
    except (Exception, SystemExit) as error:
        raise _python_error(error, "scene() failed", source) from error


def load_scene_dict(scene: dict[str, Any], source: str) -> Any:
    """Load a Mitsuba dict; what Mitsuba raises becomes an `InputError`."""
    try:
        return mi.load_dict(scene)
    except (RuntimeError, TypeError, ValueError) as error:
        raise input_error(error, source) from error


@contextmanager
def _files_beside(path: Path) -> Iterator[None]:
    """Let relative file names in a dict be found beside the scene file."""
    before = mi.file_resolver()  # type: ignore[operator]
    resolver = mi.FileResolver(before)
    resolver.prepend(str(path.resolve().parent))
    mi.set_file_resolver(resolver)  # type: ignore[operator]
    try:
        yield
    finally:
        mi.set_file_resolver(before)  # type: ignore[operator]


def _parse(name: str, text: str, default: object, source: str) -> Any:
    try:
        if isinstance(default, bool):
            return {"true": True, "false": False}[text.lower()]
        if isinstance(default, int | float):
            return type(default)(text)
        if isinstance(default, tuple):
            values = tuple(float(part) for part in text.split(","))
            if len(values) != len(default):
                raise ValueError(f"{len(default)} numbers are needed")
            return values
    except (ValueError, KeyError) as error:
        raise InputError(
            what=f'"{text}" is not a value of the parameter {name}',
            where=source,
            remedy=f"give it in the form of its default, {default}",
        ) from error
    return text


def _python_error(error: BaseException, what: str, source: str) -> InputError:
    if isinstance(error, InputError):
        return error
    return InputError(
        what=f"{what} ({type(error).__name__}: {error})",
        where=source,
        remedy="correct the scene or its parameters",
    )
