"""What is left out, each with a scene that does not need it, as data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import mitsuba as mi

import vctgi
from experiments.scenes.parts import SceneDict
from experiments.studies.elimination import scenes
from experiments.studies.elimination.frames import (
    Render,
    Rendered,
    following_frames,
    single_frames,
)
from vctgi.config import RenderConfig
from vctgi.eliminations import EXACT

ROUNDING = 2.0**-20
"""Of the lobes of an opaque mask: a mean of 16 equal weights in single precision."""

MORE_BOUNCES = 12
"""Scatterings of the room whose light bounces for long."""


def still_frames(scene: mi.Scene, config: RenderConfig) -> Render:
    """Return what makes frames of a scene that was read once."""
    return single_frames(scene, config, with_reading=False)


@dataclass(frozen=True, kw_only=True)
class Case:
    """One elimination on one scene.

    Attributes
    ----------
    name
        Unique within the study.
    keep
        Which of `vctgi.eliminations.ELIMINATIONS` it is.
    scene
        Makes the scene for a size of the picture, pixels.
    about
        What the scene is.
    change
        Changes the configuration.
    bound
        From the frame that leaves out and the one that does not, how far any number may move;
        None: no bit may.
    frames
        Makes the frames that are compared.
    in_quick
        Whether the quick version of the study measures it.
    saves
        What has to be less: operations, or peak memory, where what is not written to memory costs
        a little arithmetic. Both are the same on any machine.
    """

    name: str
    keep: str
    scene: Callable[[int], SceneDict]
    about: str
    change: Callable[[RenderConfig], RenderConfig] = lambda config: config
    bound: Callable[[Rendered, Rendered], float] | None = None
    frames: Callable[[mi.Scene, RenderConfig], Render] = still_frames
    in_quick: bool = True
    saves: Literal["operations", "memory"] = "operations"

    @property
    def bound_text(self) -> str:
        """The bound in words."""
        return EXACT if self.bound is None else "within the bound"


def _reading_frames(scene: mi.Scene, config: RenderConfig) -> Render:
    return single_frames(scene, config, with_reading=True)


def _all_sky(config: RenderConfig) -> RenderConfig:
    return replace(config, sky_in_cones=True, sky_lighting="cones")


def _isotropic(config: RenderConfig) -> RenderConfig:
    return replace(
        config, downsampling=replace(config.downsampling, is_isotropic=True, mips="average")
    )


def _many_bounces(config: RenderConfig) -> RenderConfig:
    """Bounce by few cones, for the bound holds for any."""
    few = replace(config.bounce_cones, cone_count=6, near_field_voxels=0.0)
    return replace(config, scattering_count=MORE_BOUNCES, bounce_cones=few)


def _of_albedo(_lean: Rendered, kept: Rendered) -> float:
    """Bound on all numbers: albedos and what they multiply are at most so bright."""
    return ROUNDING * float(kept.values.max())


def _of_bounces(lean: Rendered, _kept: Rendered) -> float:
    return lean.lit.left_out_radiance


COURT = "two walls, ground, one lamp, all diffuse"

CASES = [
    Case(name="specular cones", keep="specular", scene=scenes.court, about=COURT),
    Case(name="alpha", keep="alpha", scene=scenes.court, about=COURT, in_quick=False),
    Case(
        name="masks that are opaque all over",
        keep="alpha",
        scene=scenes.court_with_screen,
        about="the court, one wall behind a mask of a picture of ones",
        bound=_of_albedo,
    ),
    Case(
        name="texture coordinates",
        keep="textures",
        scene=scenes.court_with_balls,
        about="the court with three balls",
    ),
    Case(name="further levels", keep="levels", scene=scenes.court, about=COURT),
    Case(name="directions that nothing faces", keep="directions", scene=scenes.court, about=COURT),
    Case(
        name="directions that are all alike",
        keep="directions",
        scene=scenes.court,
        about=f"{COURT}; isotropic voxels",
        change=_isotropic,
    ),
    Case(
        name="lights that light nothing",
        keep="lights",
        scene=scenes.court_with_dead_lights,
        about="the court with a dark lamp and one that shines away from everything",
    ),
    Case(
        name="no sky",
        keep="sky",
        scene=scenes.court,
        about=f"{COURT}; cones of points and voxels look for a sky",
        change=_all_sky,
        in_quick=False,
    ),
    Case(
        name="a black sky",
        keep="sky",
        scene=scenes.court_at_night,
        about="the court under a sky of radiance 0; its cones look for it",
        change=_all_sky,
        frames=_reading_frames,
    ),
    Case(
        name="bounces that add little",
        keep="bounces",
        scene=scenes.closed_box,
        about=f"a closed room of albedo 0.3, up to {MORE_BOUNCES} scatterings",
        change=_many_bounces,
        bound=_of_bounces,
    ),
    Case(
        name="emission where nothing shines",
        keep="emission",
        scene=scenes.court,
        about=f"{COURT}; emission_in_voxels",
        change=lambda config: replace(config, emission_in_voxels=True),
        # Sums of light are read as they are, in place of emittance that was made of all of them.
        saves="memory",
    ),
    Case(
        name="light for ambient occlusion",
        keep="light",
        scene=scenes.court,
        about=f"{COURT}; mode ambient",
        change=lambda config: replace(
            vctgi.preset("ambient"), clipmap=config.clipmap, storage=config.storage
        ),
    ),
    Case(
        name="frames in which nothing moves",
        keep="motion",
        scene=scenes.court,
        about=f"{COURT}, frame after frame",
        frames=following_frames,
    ),
]
"""All of them, in the order of `vctgi.eliminations`."""
