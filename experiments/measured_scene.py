"""Scenes whose pictures are to be measured: loaded, and refused where they are too small."""

from __future__ import annotations

from experiments.errors import InputError
from experiments.scenes import LoadedScene, load_scene
from experiments.session import DEFAULT_RESOLUTION, SMALLEST_PICTURE


def load_measured_scene(name: str, resolution: int | None, sensor: int) -> LoadedScene:
    """Load a scene and check that its picture can be measured.

    Parameters
    ----------
    name
        As the command line takes it.
    resolution
        Longer edge of the picture, pixels; None for the default.
    sensor
        Which of its cameras.

    Raises
    ------
    InputError
        No such scene, or a picture that is too small.
    """
    loaded = load_scene(
        name,
        resolution=resolution,
        default_resolution=DEFAULT_RESOLUTION,
        sensor_index=sensor,
    )
    width, height = (int(n) for n in loaded.scene.sensors()[sensor].film().crop_size())
    if min(width, height) < SMALLEST_PICTURE:
        raise InputError(
            what=f"a picture of {width} x {height} pixels is too small to measure",
            where=name,
            remedy=f"give a --resolution that makes its shorter edge at least {SMALLEST_PICTURE}",
        )
    return loaded
