"""Which parameters of a scene the picture's derivatives reach; the others are refused.

A derivative that is cut on its way is zero without a word, and an optimiser that uses it stands
still. So only parameters are let through whose whole way is differentiated.

Where lights and shapes are is differentiated but for what becomes visible or ceases to be: rims of
shadows, outlines of shapes before the camera, surfaces that enter a voxel or that a near-field ray
newly hits. Those are biases, which `vctgi study derivatives` measures.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from vctgi.errors import SceneError

SURFACE_NAMES = (
    "reflectance",
    "diffuse_reflectance",
    "specular_reflectance",
    "base_color",
    "alpha",
    "roughness",
)
"""Parameters of BSDFs, constant or textures, that have derivatives."""

LIGHT_NAMES = ("radiance", "intensity", "irradiance")
"""Parameters of emitters that have."""

PLACE_NAMES = ("position", "to_world", "vertex_positions", "vertex_normals")
"""Parameters that say where lights and shapes are."""

VALUES = ("value", "data")
"""What constant and bitmap textures call their numbers."""


def has_derivatives(name: str) -> bool:
    """Whether the picture has derivatives by a parameter of `mi.traverse` of this name.

    So it has by some of `PLACE_NAMES`, too, which depends on what they belong to (`moving_names`).
    """
    parts = name.split(".")
    return len(parts) >= 2 and parts[-1] in VALUES and parts[-2] in (*SURFACE_NAMES, *LIGHT_NAMES)


def check_derivatives(
    scene: mi.Scene, cut: tuple[str, ...] = (), *, can_shapes_move: bool = False
) -> bool:
    """Refuse derivatives that would be cut; return whether there are others.

    Parameters
    ----------
    scene
        The scene.
    cut
        Names of `LIGHT_NAMES` whose way is not differentiated in this configuration.
    can_shapes_move
        Whether it follows shapes.

    Raises
    ------
    SceneError
        A parameter has derivatives enabled that the picture has none by.
    """
    parameters: Any = mi.traverse(scene)
    moving = moving_names(scene, can_shapes_move=can_shapes_move)
    live = [name for name in list(parameters.keys()) if dr.grad_enabled(parameters[name])]
    for name in live:
        if name not in moving and not (has_derivatives(name) and _is_whole(name, cut)):
            raise SceneError(
                "no derivative",
                f"the parameter '{name}'",
                "detach it: cameras, masks, light that voxels emit by themselves, a sky that cones "
                'see; shapes but with coverage="analytic" and one bounce; vertices of lamps, which '
                "can be moved by their to_world",
            )
    return bool(live)


def moving_names(scene: mi.Scene, *, can_shapes_move: bool) -> set[str]:
    """Return which parameters of `PLACE_NAMES` the picture has derivatives by.

    Parameters
    ----------
    scene
        The scene.
    can_shapes_move
        Whether the configuration follows shapes: analytic coverage, and light of one bounce that
        lamps send to surfaces.
    """
    parameters: Any = mi.traverse(scene)
    followed: dict[Any, tuple[str, ...]] = {
        emitter.ptr: ("position", "to_world")
        for emitter in scene.emitters()
        if emitter.class_name() in MOVING_LIGHTS
    }
    for shape in scene.shapes() if can_shapes_move else []:
        if shape.class_name() in MOVING_SHAPES:
            followed[shape.ptr] = ("to_world",)
        elif isinstance(shape, mi.Mesh) and shape.emitter() is None:
            followed[shape.ptr] = PLACE_NAMES
    # Names do not say what a parameter belongs to: a merged mesh has one that its shape has not.
    return {
        name
        for name, (_, _, owner, _) in parameters.properties.items()
        if name.rpartition(".")[2] in followed.get(getattr(owner, "ptr", None), ())
    }


MOVING_LIGHTS = ("PointLight", "SpotLight", "DirectionalEmitter")
"""Mitsuba classes of emitters without a shape that derivatives follow."""

MOVING_SHAPES = ("Rectangle", "Sphere", "Disk", "Cylinder")
"""Mitsuba classes of shapes that are moved by their `to_world` alone, lamps or not."""


def _is_whole(name: str, cut: tuple[str, ...]) -> bool:
    """Whether the parameter is none of those that are cut."""
    return name.split(".")[-2] not in cut


def has_moving_parts(emitter: mi.Emitter) -> bool:
    """Whether an emitter, or the shape that it belongs to, has derivatives by where it is."""
    shape = emitter.get_shape()
    return _has_moving(emitter) or (shape is not None and _is_moving(shape))


def has_moving_shapes(scene: mi.Scene) -> bool:
    """Whether any shape has derivatives by where it is."""
    return any(_is_moving(shape) for shape in scene.shapes())


def _is_moving(shape: mi.Shape) -> bool:
    """Whether a shape has derivatives by where it is.

    Asked in every frame, so without a list of parameters where that is not needed.
    """
    if not isinstance(shape, mi.Mesh):
        is_known = shape.class_name() in MOVING_SHAPES
        return shape.parameters_grad_enabled() if is_known else _has_moving(shape)
    # By corners, or a matrix; what only bends the shading is not among them.
    return bool(shape.parameters_grad_enabled() or dr.grad_enabled(shape.vertex_normals_buffer()))


def _has_moving(part: mi.Object) -> bool:
    parameters: Any = mi.traverse(part)
    return any(
        key.rpartition(".")[2] in PLACE_NAMES and dr.grad_enabled(parameters[key])
        for key in list(parameters.keys())
    )
