"""The emitters of a scene, as the sources of reflective shadow maps."""

from __future__ import annotations

from dataclasses import dataclass

import mitsuba as mi

KNOWN_KINDS = {
    "PointLight",
    "SpotLight",
    "DirectionalEmitter",
    "Projector",
    "AreaLight",
    "ConstantBackgroundEmitter",
    "EnvironmentMapEmitter",
    "SunskyEmitter",
}
"""Mitsuba classes whose light has been compared with the path tracer."""

CAVEATS = {
    "DirectionalArea": "lights the voxels, but no shadow ray of Mitsuba finds it, so the reference "
    "lacks its direct light and what comes of it",
    "TimedSunskyEmitter": "Mitsuba's own path tracer cannot render it on this back end",
}
"""Mitsuba classes whose light the two methods cannot agree on, and why."""

UNCOMPARED = "sampled as Mitsuba does, never compared with the path tracer"
"""What is said of every class that stands in neither list."""


@dataclass
class Light:
    """One emitter.

    Attributes
    ----------
    emitter
        The Mitsuba emitter.
    name
        For messages and the plan.
    kind
        Its Mitsuba class.
    is_infinite
        Whether its light comes from outside the scene, so that it has no position.
    is_delta_position, is_delta_direction
        Whether it shines from a point; in a single direction (at each point).
    """

    emitter: mi.Emitter
    name: str
    kind: str
    is_infinite: bool
    is_delta_position: bool
    is_delta_direction: bool


def list_lights(scene: mi.Scene) -> list[Light]:
    """Return all emitters of a scene."""
    lights = []
    for index, emitter in enumerate(scene.emitters()):
        flags = int(emitter.flags())
        kind = emitter_kind(emitter)
        lights.append(
            Light(
                emitter=emitter,
                name=_name(emitter) or f"{kind} {index}",
                kind=kind,
                is_infinite=bool(flags & int(mi.EmitterFlags.Infinite))
                or kind == "DirectionalEmitter",
                is_delta_position=bool(flags & int(mi.EmitterFlags.DeltaPosition)),
                is_delta_direction=bool(flags & int(mi.EmitterFlags.DeltaDirection)),
            )
        )
    return lights


def _name(emitter: mi.Emitter) -> str:
    """Return the name that Mitsuba's parameters have, which for a lamp begins with its shape's."""
    shape = emitter.get_shape()
    parts = [] if shape is None else [shape.id()]
    return ".".join(part for part in [*parts, emitter.id()] if part)


def emitter_kind(emitter: mi.Emitter) -> str:
    """Mitsuba class of an emitter."""
    name: str = emitter.class_name()
    return name
