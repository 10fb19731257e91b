"""The Mitsuba plugin `vctgi`: a sampling integrator that replaces indirect light by cones.

In the mode of the preset "ambient" the colour is what even light of radiance 1 from all around
would show, and there is no other light. Mitsuba asks for one camera ray at a time, whatever pixel
it belongs to, so each has cones of its own: a preset's sparse pixels are for `vctgi.render_frame`.

Emission and direct light come from Mitsuba's own `direct` integrator; light of one bounce, or of as
many as are asked for, comes from voxel cones. The voxels are made anew at every `render`, so scene
parameters that were changed through `mi.traverse` are seen.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.config import PRESETS, RenderConfig, preset, shipped_presets
from vctgi.maths.stub_gaps import as_bits, as_component, as_mask
from vctgi.parameters import ConeParameters
from vctgi.pipeline import (
    PreparedScene,
    gather_ambient,
    gather_light,
    light_volume,
    prepare_scene,
)
from vctgi.stages.gbuffer import trace_gbuffer

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    # What the stubs of Mitsuba call the arrays of an integrator's methods.
    from drjit.auto.ad import Bool, Float, TensorXf, UInt

PLUGIN_NAME = "vctgi"

SUPPORTED_VARIANTS = ("llvm_ad_rgb", "cuda_ad_rgb")

AOV_NAMES = [
    *(
        f"{name}.{c}"
        for name in ("direct", "indirect_diffuse", "indirect_specular", "albedo")
        for c in "RGB"
    ),
    *(f"normal.{c}" for c in "XYZ"),
    "depth.Z",
]
"""Channels that follow the colour: components in W m^-2 sr^-1, albedo, normal, ray distance."""

AMBIENT_AOV_NAMES = [
    "ambient.Y",
    *(name for name in AOV_NAMES if name[:3] in ("alb", "nor", "dep")),
]
"""The same in the mode "ambient": how open the hemisphere is, albedo, normal, ray distance."""


def register() -> None:
    """Register the plugin for the variant that is set, and for every variant set later."""
    mi.detail.add_variant_callback(_on_variant)
    variant = mi.variant()
    if variant is not None:
        _on_variant(None, variant)


def _on_variant(_old: str | None, new: str) -> None:
    """Define the class for a variant: its base class belongs to one."""
    factory: Callable[[mi.Properties], mi.Integrator] = (
        _integrator_class() if new in SUPPORTED_VARIANTS else _refuse
    )
    mi.register_integrator(PLUGIN_NAME, factory)


def _refuse(_props: mi.Properties) -> mi.Integrator:
    raise ValueError(
        f"vctgi: the variant '{mi.variant()}' is not supported; "
        f"set one of {', '.join(SUPPORTED_VARIANTS)}."
    )


def _config_from_properties(props: mi.Properties) -> tuple[str, RenderConfig]:
    """Read the preset and what overrides it from a plugin's properties."""
    # A property has the type that it was written with.
    get: Callable[[str, object], Any] = props.get
    name = str(get("preset", "high"))
    config = preset(name)
    resolution = int(get("resolution", config.clipmap.resolution))
    cone_count = int(get("cone_count", config.diffuse.cone_count))
    scale = float(get("aperture_scale", config.diffuse.aperture_scale))
    scattering_count = int(get("scattering_count", config.scattering_count))
    specular = config.specular
    if specular.noise == "blue":
        specular = replace(specular, noise="random")
    return name, replace(
        config,
        reconstruction=replace(config.reconstruction, sparsity=1),
        scattering_count=scattering_count,
        specular=specular,
        specular_filter=replace(config.specular_filter, kind="none"),
        clipmap=replace(config.clipmap, resolution=resolution),
        diffuse=replace(config.diffuse, cone_count=cone_count, aperture_scale=scale),
    )


def _parameters_of(config: RenderConfig) -> ConeParameters | None:
    """Return the parameters of a preset's cones; those that belong to the world have none."""
    is_tangent = config.diffuse.cones().frame == "tangent"
    return ConeParameters.from_config(config) if is_tangent else None


def _live(parameters: ConeParameters | None, *, has_own: bool) -> ConeParameters | None:
    """Return parameters that are not just the numbers of the configuration."""
    if parameters is None or not (has_own or dr.grad_enabled(dict(parameters))):
        return None
    return parameters


def _exposed(callback: mi.TraversalCallback, parameters: ConeParameters | None) -> None:
    """Show parameters by their names."""
    for name, value in (parameters or {}).items():
        callback.put(name, value, mi.ParamFlags.Differentiable)


def _integrator_class() -> type[mi.SamplingIntegrator]:
    """Return the plugin's class for the variant that is set."""

    class VoxelConeTracing(mi.SamplingIntegrator):
        """Direct light by sampling, indirect light by voxel cone tracing.

        Properties: `preset` (one of the named presets, default high), and overrides of it:
        `resolution`, `cone_count`, `aperture_scale`, `scattering_count` (surface scatterings
        between emitter and eye, default 2: one bounce); `hide_emitters` as in `direct`.
        Mitsuba hands over rays without their pixels and puts the film together itself. So phases
        of specular cones are random for every sample where the preset binds them to pixels, and
        the specular filter is left out: many samples a pixel do its work.
        `mi.traverse` shows the parameters of the cones, and the picture has derivatives by them and
        by what `vctgi.scene.derivatives` lists; Mitsuba's default `render_forward` and
        `render_backward` go through `sample`.
        Does not: media, polarisation, sparse pixels.
        """

        def __init__(self, props: mi.Properties) -> None:
            super().__init__(props)
            self.preset_name, self.config = _config_from_properties(props)
            self.direct = mi.load_dict({"type": "direct", "hide_emitters": self.hide_emitters})
            self.parameters = _parameters_of(self.config)
            self.has_own_values = False
            self.prepared: PreparedScene | None = None
            self.volume: VoxelVolume | None = None

        def render(
            self,
            scene: mi.Scene,
            sensor: mi.Sensor | int = 0,
            seed: int | UInt = 0,
            spp: int = 0,
            develop: bool = True,
            evaluate: bool = True,
        ) -> TensorXf:
            """Voxelize and light the scene, then render it as any sampling integrator."""
            camera: mi.Sensor = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
            self.prepared = prepare_scene(scene, camera, self.config)
            parameters = _live(self.parameters, has_own=self.has_own_values)
            lit = light_volume(self.prepared, self.config, parameters=parameters)
            self.volume = lit.volume
            return super().render(scene, camera, as_bits(seed), spp, develop, evaluate)

        def sample(
            self,
            scene: mi.Scene,
            sampler: mi.Sampler,
            ray: mi.RayDifferential3f,
            medium: mi.Medium | None = None,
            active: bool | Bool = True,
        ) -> tuple[mi.Spectrum, Bool, list[Float]]:
            """Radiance along camera rays, and its components."""
            if self.prepared is None or self.volume is None:
                raise RuntimeError(
                    "vctgi: sample() was called before render(); the voxels do not exist yet."
                )
            number = sampler.next_1d(as_mask(active))
            sample_index = mi.UInt32(dr.reinterpret_array(mi.UInt32, number))
            plan = self.prepared.plan
            gbuffer = trace_gbuffer(
                scene,
                ray,
                sample_index,
                self.config.gbuffer,
                has_specular=plan.has_specular,
                has_passing=plan.has_passing,
                active=mi.Bool(active),
                lobe_kinds=self.prepared.lobe_kinds,
            )
            dr.eval(gbuffer)
            normal = dr.select(gbuffer.is_valid, gbuffer.normal, 0.0)
            surface = [*gbuffer.albedo, *normal, as_component(gbuffer.depth)]
            if self.config.mode == "ambient":
                open_share = gather_ambient(
                    self.prepared,
                    gbuffer,
                    self.volume,
                    self.config,
                    None,
                    _live(self.parameters, has_own=self.has_own_values),
                )
                openness = as_component(open_share)
                total = mi.Spectrum(gbuffer.albedo * openness)
                return total, as_mask(gbuffer.is_valid), [openness, *surface]
            light = gather_light(
                self.prepared,
                gbuffer,
                self.volume,
                self.config,
                _live(self.parameters, has_own=self.has_own_values),
            )
            direct, is_valid, _ = self.direct.sample(scene, sampler, ray, medium, active)
            total = direct + light.diffuse + light.specular
            return total, is_valid, [*direct, *light.diffuse, *light.specular, *surface]

        def aov_names(self) -> list[str]:
            """Names of the channels after the colour."""
            return AMBIENT_AOV_NAMES if self.config.mode == "ambient" else AOV_NAMES

        def traverse(self, callback: mi.TraversalCallback) -> None:
            """Expose the parameters of the cones, as `vctgi.ConeParameters` names them."""
            _exposed(callback, self.parameters)

        def parameters_changed(self, keys: Sequence[str] = ()) -> None:
            """Use the values that were set from now on."""
            self.has_own_values = True

        def to_string(self) -> str:
            """One line for logs."""
            return f"VoxelConeTracing[preset={self.preset_name}]"

    return VoxelConeTracing


def known_presets() -> list[str]:
    """Names that the property `preset` takes."""
    return [*PRESETS, *shipped_presets()]
