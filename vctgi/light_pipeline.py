"""The order of the stages that light voxels, and nothing else.

plan -> light of all emitters -> injection -> sky, bounces, emission -> downsampling = volume
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import drjit as dr
import numpy as np

from vctgi.bounce_pipeline import light_by_cones
from vctgi.clipmap.storage import EmittanceClipmap, OpacityClipmap, VoxelVolume
from vctgi.config import RenderConfig
from vctgi.maths.recording import Recorder
from vctgi.parameters import ConeParameters
from vctgi.prepared import PreparedScene, StageClock
from vctgi.scene.derivatives import has_moving_parts, has_moving_shapes
from vctgi.scene.emissive import list_emissive_surfaces
from vctgi.scene.records import CountedLight, FallenLight
from vctgi.scene.surfaces import VoxelSurfaces
from vctgi.stages.downsampling import downsample_volume
from vctgi.stages.light_injection import (
    SummedLight,
    inject_all_levels,
    inject_light,
    is_by_scatter,
)
from vctgi.stages.outgoing_radiance import with_radiance
from vctgi.stages.reflective_shadow_map import (
    KeptLight,
    render_reflective_shadow_maps,
    trace_all_levels,
)
from vctgi.stages.voxelization.emittance import voxelize_emission


@dataclass
class LitVolume:
    """Lit voxels, with what was lost on the way.

    Attributes
    ----------
    volume
        Opacity and emittance.
    fallen
        What became of the light of all emitters.
    bounce_fluxes
        Flux that the voxels emit after each scattering, W; empty where light goes straight from
        the injection to the eye.
    left_out_radiance
        Bound on the radiance that further scatterings would add to any voxel, W m^-2 sr^-1, where
        they stopped because the last one added little.
    """

    volume: VoxelVolume
    fallen: FallenLight | CountedLight
    bounce_fluxes: list[float] = field(default_factory=list)
    left_out_radiance: float = 0.0

    @property
    def lost_flux_share(self) -> list[float]:
        """Share of the reflected flux that found no opacity, for each clip level."""
        return self.fallen.lost_flux_share

    @property
    def texel_count(self) -> int:
        """Lit points of all reflective shadow maps."""
        return self.fallen.texel_count


def light_voxels(
    prepared: PreparedScene,
    config: RenderConfig,
    clock: StageClock,
    voxels: tuple[VoxelSurfaces, OpacityClipmap],
    parameters: ConeParameters | None = None,
    kept: KeptLight | None = None,
    recorder: Recorder | None = None,
) -> LitVolume:
    """Light the voxels of a scene, as `vctgi.pipeline.light_volume`.

    Parameters
    ----------
    prepared, config, clock, parameters
        As there.
    voxels
        Surfaces, and their opacity at each clip level's own resolution.
    kept
        Light of earlier frames on the same voxels; None: all light is traced.
    recorder
        Keeps what is traced; None: nobody does.
    """
    plan, (surfaces, opacity) = prepared.plan, voxels
    is_live = prepared.has_derivatives or parameters is not None
    lit = _Lighting(prepared, config, clock, surfaces, opacity, recorder, is_live)
    if not plan.is_lit:
        return LitVolume(lit.downsampled(opacity, None), CountedLight([], 0))
    if parameters is None and is_by_scatter(config.injection):
        summed = lit.sum_light(kept)
        if summed is not None:
            found = lit.finish(summed, summed.fallen)
            # All is launched before the host waits.
            if np.isfinite(np.array(summed.total)).all():
                return found
    # Other rules, derivatives, or a light or surface that has to be refused by its name.
    with clock("reflective shadow maps"):
        maps = render_reflective_shadow_maps(
            prepared.scene, list(plan.lights), plan.layout, config.reflective_shadow_map, opacity
        )
    if config.injection.needs_radiance:
        with clock("radiance of lit points"):
            maps = with_radiance(prepared.scene, maps)
    with clock("light injection"):
        scale = None if parameters is None else parameters.get("prefilter_scale")
        emittance = inject_light(maps, opacity, config.injection, scale)
    count = sum(each.texel_count for each in maps)
    return lit.finish(emittance, CountedLight(emittance.lost_flux_share, count))


@dataclass
class _Lighting:
    """What is lit, how, and who watches."""

    prepared: PreparedScene
    config: RenderConfig
    clock: StageClock
    surfaces: VoxelSurfaces
    opacity: OpacityClipmap
    recorder: Recorder | None
    has_derivatives: bool

    def sum_light(self, kept: KeptLight | None) -> SummedLight | None:
        """Trace light to all levels and sum it; None where anything has derivatives."""
        prepared = self.prepared
        scene, lights = prepared.scene, list(prepared.plan.lights)
        is_moving = has_moving_shapes(scene) or any(has_moving_parts(x.emitter) for x in lights)
        if is_moving or dr.grad_enabled(self.opacity.levels):
            return None
        with self.clock("reflective shadow maps"):
            sizes, layout = self.config.reflective_shadow_map, prepared.plan.layout
            plain = prepared.plain_bsdfs
            texels = trace_all_levels(
                scene, lights, layout, sizes, self.opacity, plain, kept, self.recorder
            )
        if dr.grad_enabled(texels):
            return None
        with self.clock("light injection"):
            return inject_all_levels(texels, self.opacity, self.recorder)

    def finish(
        self, light: EmittanceClipmap | SummedLight, fallen: FallenLight | CountedLight
    ) -> LitVolume:
        """Add what light does beyond where it first lands, and store the voxels."""
        plan, opacity = self.prepared.plan, self.opacity
        fluxes: list[float] = []
        left_out = 0.0
        has_cones = plan.bounce_count > 0 or plan.has_sky_by_cones
        if has_cones or plan.has_emission:
            emittance = self._everywhere(light)
            if has_cones:
                bounced = light_by_cones(
                    self.prepared, self.surfaces, opacity, emittance, self.config, self.clock
                )
                emittance, fluxes = bounced.emittance, bounced.fluxes
                left_out = bounced.left_out
            if plan.has_emission:
                opacity, emittance = self._with_emission(emittance)
            light = emittance
        return LitVolume(self.downsampled(opacity, light), fallen, fluxes, left_out)

    def _everywhere(self, light: EmittanceClipmap | SummedLight) -> EmittanceClipmap:
        """Return the emittance of all slots."""
        if isinstance(light, EmittanceClipmap):
            return light
        with self.clock("light injection"):
            return light.emittance()

    def _with_emission(
        self, emittance: EmittanceClipmap
    ) -> tuple[OpacityClipmap, EmittanceClipmap]:
        """Add what surfaces emit by themselves."""
        with self.clock("emittance voxelization"):
            emissive = list_emissive_surfaces(self.prepared.scene)
            opacity, emitted = voxelize_emission(emissive, self.opacity)
            both = zip(emittance.levels, emitted.levels, strict=True)
            return opacity, replace(emittance, levels=[light + own for light, own in both])

    def downsampled(
        self, opacity: OpacityClipmap, light: EmittanceClipmap | SummedLight | None
    ) -> VoxelVolume:
        """Fill all levels, and store what the plan keeps of the voxels."""
        plan, config = self.prepared.plan, self.config
        with self.clock("downsampling"):
            return downsample_volume(
                opacity,
                light,
                config.downsampling,
                config.storage,
                plan.directions,
                keeps_empty=config.is_kept("levels"),
                has_derivatives=self.has_derivatives,
                recorder=self.recorder,
            )
