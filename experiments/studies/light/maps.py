"""Reflective shadow maps: their power, their evenness, and what voxels make of them.

"Exact injection" gives every slot its opacity times the mean direct light that its surfaces reflect
(`exact_voxels.py`). Both kinds of voxels are read by the same thin rays, so that the difference is
that of the maps and their injection alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import mitsuba as mi
import numpy as np

from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.cornell import cornell_box, path_traced, primary_hits
from experiments.studies.exact_voxels import exact_emittance, lay_out_window, surfaces_in
from experiments.studies.light import court, many_lamps
from experiments.studies.light.emitters import direct_power, lit_scenes, map_power
from experiments.studies.representation.thin_rays import CONFIGURATION, gather
from experiments.studies.tracers import over_phases
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, pack_volume
from vctgi.scene.lights import list_lights
from vctgi.stages.downsampling import downsample
from vctgi.stages.light_injection import inject_light
from vctgi.stages.reflective_shadow_map import (
    ReflectiveShadowMapConfig,
    render_reflective_shadow_maps,
)
from vctgi.stages.voxelization.opacity import voxelize_opacity

CLOSED_FORM = 1e-5
"""Relative error of a lamp's power in a closed room."""

QUADRATURE = 0.01
"""Relative error where texels stand for parts of different power, or count an outline."""

MONTE_CARLO = 0.015
"""Relative, four standard errors of the comparison with 2^20 points of direct light."""

SAMPLED = ("area, textured", "constant", "directional", "envmap, even")
"""Closed forms that a map is a quadrature of."""

TEXELS_PER_VOXEL = 4.0
"""A map of 256^2 texels for 64 voxels along an edge."""

ENERGY_WITHIN = 0.01
MOST_RELMSE_ADDED = 0.003

PICTURE_EDGE, PATH_COUNT = (64, 24), (2048, 1024)
"""Pixels along an edge and paths a point, in the whole study and in the quick one."""

RELATIVE_FLOOR = 0.01
"""Share of the squared mean that keeps relMSE finite in the dark."""


def checks() -> list[Check]:
    """Return the checks of the maps."""
    return [*_powers(), *_injected(), *court.checks(), *many_lamps.checks()]


def _powers() -> list[Check]:
    found = []
    for name, lit in lit_scenes().items():
        within = MONTE_CARLO if lit.power is None else CLOSED_FORM
        within = QUADRATURE if name in SAMPLED else within
        against = "Mitsuba's direct light" if lit.power is None else "closed form"
        found.append(
            Check(
                name=f"map power, {name}",
                configuration=f"full maps, over {against}",
                scene="closed room two wide" if "wall0" in lit.parts else "ball of radius 0.6",
                measure=partial(_power, name=name),
                limit_low=1.0 - within,
                limit_high=1.0 + within,
                goal=1.0,
            )
        )
    return found


def _power(_context: StudyContext, name: str) -> Measured:
    lit = lit_scenes()[name]
    scene = lit.load()
    expected = direct_power(scene) if lit.power is None else lit.power
    return Measured(value=map_power(scene) / expected)


@dataclass(frozen=True)
class BothWays:
    """Incident radiance [point, rgb] through injected and exact voxels, for each phase."""

    injected: list[np.ndarray]
    exact: list[np.ndarray]
    halves: tuple[np.ndarray, np.ndarray]

    def relmse(self, found: np.ndarray) -> float:
        """Mean (V - R1)(V - R2) / (R^2 + floor)."""
        first, second = self.halves
        truth = 0.5 * (first + second)
        scale = truth**2 + RELATIVE_FLOOR * truth.mean() ** 2
        return float(np.mean((found - first) * (found - second) / scale))


def _injected() -> list[Check]:
    configuration = f"map of 256^2 texels, scatter; {CONFIGURATION}"
    scene = "mi.cornell_box(), E / pi of one bounce at primary hits"
    return [
        Check(
            name="area light, energy over exact injection",
            configuration=configuration,
            scene=scene,
            measure=_energy,
            in_quick=False,
            limit_low=1.0 - ENERGY_WITHIN,
            limit_high=1.0 + ENERGY_WITHIN,
            goal=1.0,
        ),
        Check(
            name="area light, relMSE more than exact injection",
            configuration=configuration,
            scene=scene,
            measure=_added_relmse,
            in_quick=False,
            limit_high=MOST_RELMSE_ADDED,
            goal=0.0,
        ),
    ]


def _both_ways(context: StudyContext) -> BothWays:
    return context.once("light, Cornell box", partial(_trace_both_ways, context))


def _trace_both_ways(context: StudyContext) -> BothWays:
    still = cornell_box(np.zeros(3))
    at = primary_hits(still, PICTURE_EDGE[context.quick])
    first, second = (path_traced(still, at, PATH_COUNT[context.quick], seed) for seed in (1, 2))
    layout = lay_out_window(still.triangles)

    def at_phase(phase: np.ndarray) -> np.ndarray:
        """Return radiance [injected or exact, point, rgb]."""
        offset = phase * layout.finest_voxel_size
        room = cornell_box(offset)
        surfaces = surfaces_in(room.scene)
        opacity = voxelize_opacity(surfaces, layout)
        exact = exact_emittance(opacity, surfaces.vertices, room.radiance)
        config = ReflectiveShadowMapConfig(texels_per_voxel=TEXELS_PER_VOXEL)
        maps = render_reflective_shadow_maps(room.scene, list_lights(room.scene), layout, config)
        injected = inject_light(maps, opacity)
        read = [
            _read(each, opacity, room.scene, at.points + offset, at.normals)
            for each in (injected, exact)
        ]
        return np.stack(read)

    both = over_phases(context, at_phase)
    return BothWays([each[0] for each in both], [each[1] for each in both], (first, second))


def _read(
    emittance: EmittanceClipmap,
    opacity: OpacityClipmap,
    scene: mi.Scene,
    points: np.ndarray,
    normals: np.ndarray,
) -> np.ndarray:
    """E / pi [point, rgb] by thin rays."""
    merged, lit = downsample(opacity, emittance)
    assert lit is not None, "downsampling keeps the emittance it is given"
    return gather(pack_volume(merged, lit), scene, points, normals)


def _energy(context: StudyContext) -> Measured:
    both = _both_ways(context)
    pairs = zip(both.injected, both.exact, strict=True)
    return mean_of([float(found.mean() / exact.mean()) for found, exact in pairs])


def _added_relmse(context: StudyContext) -> Measured:
    both = _both_ways(context)
    pairs = zip(both.injected, both.exact, strict=True)
    return mean_of([both.relmse(found) - both.relmse(exact) for found, exact in pairs])
