"""A scene as the renderer sees it, and what times its stages."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Protocol

import mitsuba as mi

from vctgi.plan import Plan
from vctgi.scene.materials import Material
from vctgi.scene.sky import PrefilteredSky
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.scene.triangles import SceneTriangles


class StageClock(Protocol):
    """Something that can time a stage."""

    def __call__(self, stage: str) -> AbstractContextManager[object]:
        """Return a context that lasts as long as the stage."""


def no_clock(stage: str) -> AbstractContextManager[object]:
    """Time nothing."""
    return nullcontext(stage)


@dataclass
class PreparedScene:
    """A scene as the renderer sees it.

    Attributes
    ----------
    scene, sensor
        The Mitsuba scene and the camera it was prepared for.
    triangles, materials, surfaces
        Geometry, what its BSDFs contribute, and the sides that are voxelized.
    plan
        What is run and what is left out.
    plain_bsdfs
        Which BSDFs reflect a texture evenly and do nothing else.
    sky
        The environment for cones, if any of them see it.
    lobe_kinds
        Which BSDFs have their lobes' cones in a table, if any has.
    has_derivatives
        Whether any parameter of the scene has.
    """

    scene: mi.Scene
    sensor: mi.Sensor
    triangles: SceneTriangles
    materials: list[Material]
    surfaces: VoxelSurfaces
    plan: Plan
    plain_bsdfs: mi.UInt32
    sky: PrefilteredSky | None = None
    lobe_kinds: mi.UInt32 | None = None
    has_derivatives: bool = False
