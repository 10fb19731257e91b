"""The views that a fit is judged by: a scene, a camera, and what paths find there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mitsuba as mi
import numpy as np

import metrics
import reference
from experiments.errors import InputError
from experiments.optimize.target import Target, make_target
from experiments.scenes import LoadedScene, load_scene
from vctgi.config import RenderConfig

TURN_DEGREES = 12.0
"""Turn of a held-out view of a training scene about the camera's own upward axis: a part of the
picture shows other surfaces, and all lie elsewhere in the lattice, as the clipmap follows it."""

BATCH_COUNT = 8
"""Independent batches of a reference."""

COMPONENT = "indirect_diffuse"
"""The light that is fitted."""


@dataclass(frozen=True, kw_only=True)
class ViewName:
    """Which view."""

    scene: str
    """What the user named."""
    is_turned: bool = False
    """Whether the camera is turned by `TURN_DEGREES`."""

    @property
    def title(self) -> str:
        """What tables call it."""
        name = Path(self.scene).stem if "." in self.scene else self.scene
        return f"{name}, turned" if self.is_turned else name


@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """What all views share."""

    resolution: int
    """Longer edge of the picture, pixels."""
    reference_spp: int
    """Paths a pixel."""
    seed: int
    """Start of the reference's random numbers."""
    cache: Path | None
    """Where references are kept."""


@dataclass(kw_only=True)
class View:
    """A view with its reference.

    Attributes
    ----------
    name
        Which one.
    options
        Picture size.
    key
        Hash of all that its reference depends on.
    batches
        Reference [batch, y, x, rgb].
    target
        The error of a picture.
    noise
        Relative squared error of the reference itself.
    """

    name: ViewName
    options: ViewOptions
    key: str
    batches: np.ndarray
    target: Target
    noise: float


def load_view(name: ViewName, options: ViewOptions) -> LoadedScene:
    """Load a scene anew and turn its camera where that is asked for."""
    loaded = load_scene(name.scene, resolution=options.resolution)
    if name.is_turned:
        sensor = loaded.scene.sensors()[loaded.sensor_index]
        parameters = mi.traverse(sensor)
        turn = mi.ScalarTransform4f().rotate([0, 1, 0], TURN_DEGREES)
        before = _matrix(parameters["to_world"])
        parameters["to_world"] = mi.Transform4f(before @ turn)
        parameters.update()
    return loaded


def make_view(
    name: ViewName,
    options: ViewOptions,
    config: RenderConfig,
    progress: Callable[[str, float], None],
) -> View:
    """Path-trace a view, or read its reference from the cache.

    Raises
    ------
    InputError
        A scene that cannot be used, or a view that sees no indirect diffuse light.
    """
    loaded = load_view(name, options)
    truth = reference.render_reference(
        loaded.scene,
        sensor=loaded.sensor_index,
        request=reference.ReferenceRequest(
            samples_per_pixel=options.reference_spp,
            batch_count=BATCH_COUNT,
            scattering_count=config.scattering_count,
            seed=options.seed,
            rest_samples_per_pixel=0,
        ),
        cache_directory=options.cache,
        progress=lambda share: progress("path tracing", share),
    )
    batches = truth.batches(COMPONENT)
    try:
        target = make_target(batches)
    except ValueError as error:
        raise InputError(
            what="this view sees no indirect diffuse light",
            where=name.title,
            remedy="leave it out, or give more --spp",
        ) from error
    noise = metrics.reference_noise_relmse(batches).value
    return View(
        name=name, options=options, key=truth.key, batches=batches, target=target, noise=noise
    )


def move_scene(scene: mi.Scene, offset: np.ndarray, title: str) -> None:
    """Move all of a scene, camera and lamps with it, by a vector, world units.

    The windows of the clipmap are snapped to their lattice, so what moves against it is the scene.

    Raises
    ------
    InputError
        A part of it did not follow.
    """
    before = _corners(scene)
    moved = mi.ScalarTransform4f().translate(offset.tolist())
    parameters = mi.traverse(scene)
    # SceneParameters iterates over pairs, so its keys must be asked for.
    for key in parameters.keys():  # type: ignore[no-untyped-call]  # noqa: SIM118
        last = key.rpartition(".")[2]
        if last == "vertex_positions":
            positions = np.array(parameters[key], dtype=np.float64).reshape(-1, 3) + offset
            parameters[key] = mi.Float(positions.astype(np.float32).ravel())
        elif last == "to_world":
            parameters[key] = mi.Transform4f(moved @ _matrix(parameters[key]))
        elif last == "position":
            place = np.array(parameters[key], dtype=np.float64).ravel() + offset
            parameters[key] = mi.Point3f(*place.tolist())
    parameters.update()
    after = _corners(scene)
    reach = float(np.abs(before).max()) + 1.0
    if not np.allclose(after, before + offset, atol=SINGLE_PRECISION * reach):
        raise InputError(
            what="the scene cannot be moved against the voxels, because it holds an object whose "
            "place Mitsuba does not let one change, such as an instance",
            where=title,
            remedy="fit on another scene",
        )


SINGLE_PRECISION = 1e-5
"""Relative rounding of places in single precision, with room for transformations."""


def _corners(scene: mi.Scene) -> np.ndarray:
    box = scene.bbox()
    return np.array([np.array(box.min).ravel(), np.array(box.max).ravel()], dtype=np.float64)


def _matrix(transform: mi.Transform4f) -> mi.ScalarTransform4f:
    """Return the one transformation of an array of one."""
    return mi.ScalarTransform4f(np.array(transform.matrix, dtype=np.float32).reshape(4, 4))
