"""What a frame's diffuse light could gain: its error by noise, sparse pixels and number of cones.

The error is a quadratic function of the picture (`experiments.optimize.target`), so the product of
two pictures of the same voxels with other random numbers is the error that noise has no part in.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import vctgi
from experiments.optimize.frames import FrameSource
from experiments.optimize.views import View, ViewName, ViewOptions, make_view
from experiments.studies.check import StudyContext
from vctgi.config import RenderConfig

PRESET = "high"
"""What is taken apart, and what a fit is compared with."""

MANY_CONES = 64
"""Cones of the richer set, that of preset "ultra"."""


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How large the measurements are."""

    resolution: int
    """Longer edge of the pictures, pixels."""
    places: int
    """Places in the lattice of the voxels."""
    spp: int
    """Paths a pixel of the references."""


EFFORT = (
    Effort(resolution=128, places=4, spp=4096),
    Effort(resolution=48, places=2, spp=1024),
)
"""In the whole study and in the quick one."""


@dataclass(frozen=True)
class Budget:
    """Shares of a frame's `relmse_e2`, each for every place; their sum is `frame`.

    Attributes
    ----------
    frame
        Error of one frame.
    noise
        What other random numbers change of it.
    sparse
        What dense pixels take off.
    cones
        What 64 cones in place of the preset's take off dense pixels.
    rest
        Error of those: voxels, light maps, and the width that cones have even so.
    """

    frame: tuple[float, ...]
    noise: tuple[float, ...]
    sparse: tuple[float, ...]
    cones: tuple[float, ...]
    rest: tuple[float, ...]


def study_view(context: StudyContext, scene: str) -> View:
    """Return a scene at the study's size with its reference, path-traced once in a study."""
    effort = EFFORT[context.quick]

    def make() -> View:
        options = ViewOptions(
            resolution=effort.resolution, reference_spp=effort.spp, seed=0, cache=None
        )
        return make_view(ViewName(scene=scene), options, vctgi.preset(PRESET), context.progress)

    return context.once(f"fitted, view {scene}", make)


def budget_of(context: StudyContext, scene: str) -> Budget:
    """Return the shares of a scene, measured once in a study."""
    return context.once(f"fitted, budget {scene}", lambda: _budget(context, scene))


def _budget(context: StudyContext, scene: str) -> Budget:
    view, base = study_view(context, scene), vctgi.preset(PRESET)
    reconstruction = replace(base.reconstruction, sparsity=1)
    dense = replace(base, reconstruction=reconstruction)
    many = replace(dense, diffuse=replace(dense.diffuse, cone_count=MANY_CONES))
    source = FrameSource(0, "differences")
    rows = []
    places = EFFORT[context.quick].places
    for place in range(places):
        context.progress(f"budget of {view.name.title}", place / places)
        frame, quiet = _errors(view, source, place, base)
        _, dense_quiet = _errors(view, source, place, dense)
        _, many_quiet = _errors(view, source, place, many)
        parts = (frame - quiet, quiet - dense_quiet, dense_quiet - many_quiet, many_quiet)
        rows.append((frame, *parts))
    return Budget(*zip(*rows, strict=True))


def _errors(
    view: View, source: FrameSource, place: int, config: RenderConfig
) -> tuple[float, float]:
    """Return the error of one frame, and that without noise."""
    one, other = (source.picture(view, place, config, repeat=n).image for n in (0, 1))
    frame = 0.5 * (view.target.error(one) + view.target.error(other))
    return frame, view.target.common_error(one, other)
