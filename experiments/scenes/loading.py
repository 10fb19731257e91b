"""From what a user names on the command line to a checked Mitsuba scene."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import mitsuba as mi

from experiments.errors import InputError
from experiments.scenes.catalogue import BUILT_IN
from experiments.scenes.checks import check_scene
from experiments.scenes.mesh_files import mesh_scene
from experiments.scenes.mitsuba_errors import captured_warnings, input_error
from experiments.scenes.notes import read_notes
from experiments.scenes.python_scenes import (
    call_scene_function,
    load_python_scene,
    load_scene_dict,
)

_MESH_SUFFIXES: Final = (".gltf", ".glb", ".obj", ".ply")
_SUFFIXES: Final = (".xml", ".py", *_MESH_SUFFIXES)


@dataclass(frozen=True, kw_only=True)
class LoadedScene:
    """A scene that has passed the checks."""

    name: str
    """Short name, fit for file names."""
    title: str
    purpose: str
    """What the scene tests, or an empty string."""
    source: str
    """What the user named."""
    scene: mi.Scene
    sensor_index: int
    """The camera that was checked and resized."""
    credit: str = ""
    """`Author, Licence`, where a text beside the scene names them."""
    warnings: list[str] = field(default_factory=list)
    """What was left out or looked odd."""


@dataclass(kw_only=True)
class _Draft:
    """What is known before the checks."""

    loaded: Any
    name: str
    title: str = ""
    purpose: str = ""
    credit: str = ""
    warnings: list[str] = field(default_factory=list)


def load_scene(
    source: str,
    *,
    resolution: int | tuple[int, int] | None = None,
    default_resolution: int | None = None,
    parameters: dict[str, str] | None = None,
    sensor_index: int = 0,
    needs_light: bool = True,
) -> LoadedScene:
    """Load, resize and check a scene; the Mitsuba variant must be set.

    Parameters
    ----------
    source
        Name of a built-in scene, or a path: Mitsuba `.xml`, a `.py` file with a function `scene()`
        that returns a Mitsuba dict, or a `.gltf`, `.glb`, `.obj` or `.ply` mesh.
    resolution
        Film size in pixels: (width, height), or the longer edge with the aspect kept. The field of
        view across the picture stays as the scene has it. Left out: the default.
    default_resolution
        The same for a film without a crop window; left out: the size in the scene.
    parameters
        Values for the parameters of an XML scene, or for the keyword arguments of a scene function.
    sensor_index
        Which camera, from 0.
    needs_light
        Whether a scene without light is refused.

    Raises
    ------
    InputError
        For anything that is wrong with the input, as one line; the original error is its cause.
    """
    given = parameters or {}
    with captured_warnings() as messages:
        draft = _load(source, given)
    if not isinstance(draft.loaded, mi.Scene):
        raise InputError(
            what=f"this is a {type(draft.loaded).__name__}, not a Mitsuba scene",
            where=source,
            remedy="put it into a <scene> (in Python: a dict with type 'scene')",
        )
    warnings = [
        *draft.warnings,
        *messages,
        *check_scene(draft.loaded, sensor_index, source, needs_light=needs_light),
    ]
    sensor = draft.loaded.sensors()[sensor_index]
    if resolution is None and not _has_crop_window(sensor):
        resolution = default_resolution
    if resolution is not None:
        _resize(sensor, resolution, source)
    return LoadedScene(
        name=draft.name,
        title=draft.title or draft.name.replace("_", " ").replace("-", " ").capitalize(),
        purpose=draft.purpose,
        source=source,
        scene=draft.loaded,
        sensor_index=sensor_index,
        credit=draft.credit,
        warnings=warnings,
    )


def _load(source: str, parameters: dict[str, str]) -> _Draft:
    if source in BUILT_IN:
        entry = BUILT_IN[source]
        loaded = load_scene_dict(call_scene_function(entry.function, parameters, source), source)
        return _Draft(loaded=loaded, name=entry.name, title=entry.title, purpose=entry.purpose)
    path = Path(source)
    _require_scene_file(path, source)
    suffix = path.suffix.lower()
    if suffix == ".xml":
        return _load_xml(path, parameters)
    if suffix == ".py":
        loaded, purpose = load_python_scene(path, parameters)
        credit = read_notes(path.resolve().parent).credit
        return _Draft(loaded=loaded, name=path.stem, purpose=purpose, credit=credit)
    if parameters:
        raise InputError(
            what="a mesh file has no parameters",
            where=source,
            remedy=f"leave out {', '.join(parameters)}",
        )
    try:
        scene, warnings = mesh_scene(path.resolve())
    except RuntimeError as error:
        raise input_error(error, source) from error
    notes = read_notes(path.resolve().parent)
    return _Draft(
        loaded=load_scene_dict(scene, source),
        name=path.stem,
        credit=notes.credit,
        warnings=warnings,
    )


def _require_scene_file(path: Path, source: str) -> None:
    if not path.exists():
        if path.suffix:
            raise InputError(
                what="there is no such file", where=source, remedy="correct the path of the scene"
            )
        raise InputError(
            what="there is no built-in scene and no file of this name",
            where=source,
            remedy=f"name a scene file or one of: {', '.join(BUILT_IN)}",
        )
    if path.is_dir():
        raise InputError(
            what="this is a folder, not a scene", where=source, remedy="name the scene file in it"
        )
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(
            what=f'a file with the ending "{path.suffix}" is not a scene',
            where=source,
            remedy=f"give a file that ends in one of: {', '.join(_SUFFIXES)}",
        )


def _load_xml(path: Path, parameters: dict[str, str]) -> _Draft:
    try:
        loaded = mi.load_file(str(path), True, True, **parameters)
    except RuntimeError as error:
        raise input_error(error, str(path)) from error
    folder = path.resolve().parent
    notes = read_notes(folder)
    title = notes.title
    if title and path.stem != "scene":
        title = f"{title} ({path.stem.removeprefix('scene_').replace('_', ' ')})"
    return _Draft(
        loaded=loaded,
        name=scene_file_name(path),
        title=title,
        purpose=notes.purpose,
        credit=notes.credit,
    )


def scene_file_name(path: Path) -> str:
    """Return the name of a scene by its file, or by its folder where files are called ``scene``."""
    if path.stem == "scene" or path.stem.startswith("scene_"):
        return (path.resolve().parent.name + path.stem.removeprefix("scene")).replace("_", "-")
    return path.stem


def _has_crop_window(sensor: mi.Sensor) -> bool:
    """Whether the film shows only a part of its picture."""
    film = sensor.film()
    return [int(n) for n in film.crop_size()] != [int(n) for n in film.size()]


def _resize(sensor: mi.Sensor, resolution: int | tuple[int, int], source: str) -> None:
    """Give the film a new size; Mitsuba keeps the horizontal field of view."""
    parameters = mi.traverse(sensor)
    old = tuple(int(edge) for edge in sensor.film().size())
    cropped = tuple(int(edge) for edge in sensor.film().crop_size())
    if isinstance(resolution, tuple):
        size = resolution
    else:
        longer = max(old)
        size = (
            max(1, round(resolution * old[0] / longer)),
            max(1, round(resolution * old[1] / longer)),
        )
    if min(size) < 1 or (not isinstance(resolution, tuple) and resolution < 1):
        raise InputError(
            what=f"the resolution {resolution} is not a picture size",
            where=source,
            remedy="give whole numbers of pixels of at least 1",
        )
    if cropped != old:
        raise InputError(
            what="the film has a crop window and cannot be given another resolution",
            where=source,
            remedy="remove the crop from the scene or leave the resolution out",
        )
    parameters["film.size"] = list(size)
    parameters.update()
