"""A small room and its mean picture as a function of one parameter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.check import StudyContext
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.clipmap.storage import StorageConfig
from vctgi.config import RenderConfig, preset
from vctgi.parameters import ConeParameters
from vctgi.pipeline import light_volume, prepare_scene, render_frame
from vctgi.prepared import PreparedScene

EDGE = (96, 48)
"""Pixels along an edge of the picture, in the whole study and in the quick one; a ray each. The
more points, the less it matters where each one's kinks are."""

START = {"step_ratio": 0.47, "min_step_voxels": 0.27, "start_offset_voxels": 1.03}
"""Values of the march off the preset's, at which steps by its two rules are equally long for many
cones at once: a derivative there is that of one side."""

SCENE_NAMES = {
    "albedo of the walls": "white.reflectance.value",
    "radiance of the lamp": "light.emitter.radiance.value",
    "roughness of the ball": "small-box.bsdf.alpha.value",
}
"""Parameters of the scene."""

POINTS = (0.93, 1.0, 1.07)
"""Factors on a parameter's values at which derivatives are taken."""


@dataclass(kw_only=True)
class DerivativeRoom:
    """The room.

    Attributes
    ----------
    scene, scene_parameters
        A closed room with a lamp and a glossy ball, and what `mi.traverse` shows of it.
    config
        How it is rendered.
    prepared
        The scene for cones, lit at its own parameters.
    volume
        Its voxels.
    start
        Values of the scene's parameters that were moved.
    """

    scene: mi.Scene
    scene_parameters: Any
    config: RenderConfig
    prepared: PreparedScene
    volume: Any
    start: dict[str, Any] = field(default_factory=dict)

    def with_cones(
        self, name: str, config: RenderConfig | None = None, seed: int = 0
    ) -> Callable[[mi.Float], mi.Float]:
        """Return the picture's numbers as a function of a parameter of the cones."""

        def picture(values: mi.Float) -> mi.Float:
            return self.numbers({name: values}, config, seed)

        return picture

    def numbers(
        self, values: dict[str, mi.Float], config: RenderConfig | None = None, seed: int = 0
    ) -> mi.Float:
        """Return the picture's numbers where some of the cones' parameters have these values."""
        self.restore()
        parameters = self.cones()
        for name, value in values.items():
            parameters[name] = value
        return _numbers(self.prepared, self.volume, config or self.config, parameters, seed)

    def with_scene(
        self, name: str, config: RenderConfig, seed: int = 0
    ) -> Callable[[Any], mi.Float]:
        """Return the picture's numbers as a function of a parameter of the scene."""

        def picture(values: Any) -> mi.Float:
            self.restore()
            held = self.scene_parameters
            self.start.setdefault(name, type(held[name])(held[name]))
            held[name] = values
            held.update()
            prepared = prepare_scene(self.scene, self.scene.sensors()[0], config)
            return _numbers(prepared, light_volume(prepared, config).volume, config, None, seed)

        return picture

    def restore(self) -> None:
        """Set the scene's parameters back, at the last moment.

        Reverse mode calls Mitsuba's BSDFs and emitters again, as they are then: one that was set
        back before has a derivative of zero.
        """
        for name, value in self.start.items():
            self.scene_parameters[name] = value
        self.scene_parameters.update()

    def cones(self) -> ConeParameters:
        """Return the cones' parameters where derivatives are taken."""
        parameters = ConeParameters.from_config(self.config)
        for name, value in START.items():
            parameters[name] = dr.opaque(mi.Float, value)
        return parameters


def derivative_room(context: StudyContext) -> DerivativeRoom:
    """Return the room, made once."""
    return context.once("derivatives, room", partial(_make_room, EDGE[int(context.quick)]))


def _make_room(edge: int) -> DerivativeRoom:
    scene = mi.load_dict(_description(edge))
    high = preset("high")
    config = replace(
        high,
        clipmap=ClipmapConfig(resolution=32),
        storage=StorageConfig(),
        reconstruction=replace(high.reconstruction, sparsity=1),
        samples_per_pixel=1,
        diffuse=replace(high.diffuse, cone_count=16, near_field_voxels=0.0),
    )
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    volume = light_volume(prepared, config).volume
    return DerivativeRoom(
        scene=scene,
        scene_parameters=mi.traverse(scene),
        config=config,
        prepared=prepared,
        volume=volume,
    )


def _description(edge: int) -> dict[str, Any]:
    description: Any = mi.cornell_box()  # type: ignore[no-untyped-call]
    description["sensor"]["film"].update(
        width=edge, height=edge, rfilter={"type": "box"}, component_format="float32"
    )
    description["small-box"] = {
        "type": "sphere",
        "center": [0.35, -0.6, 0.3],
        "radius": 0.35,
        "bsdf": {"type": "roughconductor", "alpha": 0.27},
    }
    found: dict[str, Any] = description
    return found


def _numbers(
    prepared: PreparedScene,
    volume: Any,
    config: RenderConfig,
    parameters: ConeParameters | None,
    seed: int,
) -> mi.Float:
    """Every number of a picture of indirect light."""
    frame = render_frame(prepared, volume, config, parameters=parameters, seed=seed)
    return mi.Float(frame.indirect_diffuse.array + frame.indirect_specular.array)


def way_of(count: int) -> np.ndarray:
    """Return the share by which each of a parameter's values is moved: not all alike."""
    return 1.0 + 0.5 * np.sin(np.arange(count, dtype=np.float64)) if count > 1 else np.ones(1)
