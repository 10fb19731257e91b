"""The configuration of a frame, composed of its stages' own, and the named presets."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Literal, TypeVar, get_args

from vctgi.clipmap.levels import ClipmapConfig
from vctgi.clipmap.storage import StorageConfig
from vctgi.eliminations import ALL, check_names
from vctgi.errors import PresetFileError
from vctgi.peers import PEER_PREFIX, PEERS, find_peer, peer_names
from vctgi.preset_file import SUFFIX, changed_config, is_preset_file, read_preset_file
from vctgi.scene.sky import SkyConfig
from vctgi.stages.bounces import BouncesConfig
from vctgi.stages.cone_tracing.ambient import AmbientConfig
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig
from vctgi.stages.cone_tracing.march import ConeMarchConfig
from vctgi.stages.cone_tracing.specular import SpecularConesConfig
from vctgi.stages.downsampling import DownsamplingConfig
from vctgi.stages.gbuffer import GBufferConfig
from vctgi.stages.light_injection import LightInjectionConfig
from vctgi.stages.reconstruction.config import ReconstructionConfig
from vctgi.stages.reconstruction.denoising import SpecularFilterConfig
from vctgi.stages.reconstruction.temporal import TemporalConfig
from vctgi.stages.reflective_shadow_map import ReflectiveShadowMapConfig
from vctgi.stages.slot_surfaces.slots import SlotSurfacesConfig
from vctgi.stages.voxelization.opacity import OpacityVoxelizationConfig

LEAST_SCATTERING_COUNT = 2
"""Surface scatterings between emitter and eye of the simplest indirect light: one bounce."""

SkyLighting = Literal["maps", "cones"]
"""How the environment lights voxels: by reflective shadow maps, or by the voxels' own cones."""

Mode = Literal["indirect", "ambient"]
"""What is rendered: indirect light, or ambient occlusion alone."""


@dataclass(frozen=True, kw_only=True)
class RenderConfig:
    """Everything that shapes a frame, apart from the scene."""

    mode: Mode = "indirect"
    """What is rendered: "indirect" light, or "ambient" occlusion, which needs no light at all."""

    clipmap: ClipmapConfig = field(default_factory=ClipmapConfig)
    """Size of the clipmap."""
    voxelization: OpacityVoxelizationConfig = field(default_factory=OpacityVoxelizationConfig)
    """How surfaces become opacity."""
    downsampling: DownsamplingConfig = field(default_factory=DownsamplingConfig)
    """How levels are filled from finer ones."""
    storage: StorageConfig = field(default_factory=StorageConfig)
    """How voxels are stored for reading."""
    reflective_shadow_map: ReflectiveShadowMapConfig = field(
        default_factory=ReflectiveShadowMapConfig
    )
    """Resolution of the light maps."""
    injection: LightInjectionConfig = field(default_factory=LightInjectionConfig)
    """How light gets into voxels."""
    emission_in_voxels: bool = False
    """Whether emitters shine from voxels too. Mitsuba renders what they send straight to a point,
    so their light is then counted twice; for studies of light from emissive voxels."""
    gbuffer: GBufferConfig = field(default_factory=GBufferConfig)
    """Effort for measuring lobes."""
    diffuse: DiffuseConesConfig = field(default_factory=DiffuseConesConfig)
    """Diffuse cones."""
    specular: SpecularConesConfig = field(default_factory=SpecularConesConfig)
    """Specular cones."""
    ambient: AmbientConfig = field(default_factory=AmbientConfig)
    """Cones of the mode "ambient"."""
    reconstruction: ReconstructionConfig = field(default_factory=ReconstructionConfig)
    """How many pixels trace diffuse or ambient cones."""
    temporal: TemporalConfig = field(default_factory=TemporalConfig)
    """How `vctgi.accumulate_frame` blends frames; a frame by itself knows no other."""
    specular_filter: SpecularFilterConfig = field(default_factory=SpecularFilterConfig)
    """Filter of what specular cones see."""
    samples_per_pixel: int = 4
    """Camera rays a pixel, >= 1. Each has cones of its own, or takes the diffuse light of the
    traced pixels around it."""
    scattering_count: int = LEAST_SCATTERING_COUNT
    """Most surface scatterings between emitter and eye of the light that is rendered, >= 2: 2 is
    one bounce."""
    bounces: BouncesConfig = field(default_factory=BouncesConfig)
    """When bounces stop before that."""
    bounce_cones: DiffuseConesConfig = field(default_factory=lambda: _diffuse(32, -1.5, 2.0))
    """Cones by which voxels gather light from voxels."""
    slot_surfaces: SlotSurfacesConfig = field(default_factory=SlotSurfacesConfig)
    """How the surfaces are found that voxels gather light for."""
    sky_lighting: SkyLighting = "maps"
    """How the environment lights voxels: "maps" or "cones"."""
    sky_in_cones: bool = False
    """Whether cones that leave the clipmap see the environment: then its light, which is direct,
    is part of the frame, and must not be added to it by another renderer again."""
    sky: SkyConfig = field(default_factory=SkyConfig)
    """How the environment is averaged for cones."""
    keep: tuple[str, ...] = ()
    """Names of `vctgi.eliminations.ELIMINATIONS` that are kept even where the scene does not need
    them, or "all": for measuring what leaving them out saves."""

    def __post_init__(self) -> None:
        """Refuse an empty picture, and one without indirect light."""
        check_names(self.keep)
        if self.samples_per_pixel < 1:
            raise ValueError(
                f"RenderConfig.samples_per_pixel must be >= 1, got {self.samples_per_pixel}."
            )
        if self.scattering_count < LEAST_SCATTERING_COUNT:
            raise ValueError(
                f"RenderConfig.scattering_count must be >= {LEAST_SCATTERING_COUNT}, "
                f"got {self.scattering_count}: light of one scattering is direct."
            )
        if self.mode not in get_args(Mode):
            raise ValueError(
                f"RenderConfig.mode must be one of {get_args(Mode)}, got {self.mode!r}."
            )
        if self.sky_lighting not in get_args(SkyLighting):
            raise ValueError(
                f"RenderConfig.sky_lighting must be one of {get_args(SkyLighting)}, "
                f"got {self.sky_lighting!r}."
            )

    def is_kept(self, name: str) -> bool:
        """Whether something is kept that the scene may not need."""
        return name in self.keep or ALL in self.keep

    @property
    def bounce_count(self) -> int:
        """Scatterings from voxel to voxel, between the first one and the one that is seen."""
        return self.scattering_count - LEAST_SCATTERING_COUNT


Cones = TypeVar("Cones", DiffuseConesConfig, AmbientConfig)


def _diffuse(
    cone_count: int, level_bias: float, near_field_voxels: float, pull_back_voxels: float = 0.25
) -> DiffuseConesConfig:
    """Return a cone set; few cones want a finer level than many (docs/decisions/0001)."""
    return DiffuseConesConfig(
        cone_count=cone_count,
        near_field_voxels=near_field_voxels,
        march=ConeMarchConfig(level_bias=level_bias, pull_back_voxels=pull_back_voxels),
    )


def _chosen(cones: Cones) -> Cones:
    """Return the cones of a cheap preset, which read one level of two (docs/decisions/0027)."""
    return replace(cones, march=replace(cones.march, filtering="random_level"))


_DEFAULT = RenderConfig(storage=StorageConfig(format="auto"))

PRESETS: dict[str, RenderConfig] = {
    "ambient": replace(
        _DEFAULT,
        mode="ambient",
        ambient=_chosen(AmbientConfig()),
        samples_per_pixel=2,
        reconstruction=ReconstructionConfig(sparsity=4),
    ),
    "medium": replace(
        _DEFAULT,
        diffuse=_chosen(_diffuse(6, -1.0, 0.0)),
        samples_per_pixel=2,
        reconstruction=ReconstructionConfig(sparsity=4),
    ),
    "high": replace(
        _DEFAULT,
        clipmap=ClipmapConfig(resolution=128),
        diffuse=_diffuse(17, -1.0, 3.0, 0.4),
        reconstruction=ReconstructionConfig(sparsity=9, max_contrast=0.7),
    ),
    "ultra": replace(
        _DEFAULT, clipmap=ClipmapConfig(resolution=128), diffuse=_diffuse(64, -1.0, 4.0, 0.4)
    ),
}
"""Named configurations, from cheap to dear."""


SHIPPED_FOLDER = Path(__file__).parent / "presets"
"""Preset files that come with the package; each is a preset of its file's name."""


@cache
def shipped_presets() -> dict[str, Path]:
    """Return the preset files that come with the package, by name."""
    return {path.stem: path for path in sorted(SHIPPED_FOLDER.glob(f"*{SUFFIX}"))}


def preset_names() -> list[str]:
    """Return all names that `preset` takes: ours from cheap to dear, fitted ones, the peers'.

    It takes the path of a preset file besides.
    """
    return [*PRESETS, *shipped_presets(), *peer_names()]


def preset(name: str) -> RenderConfig:
    """Return the named preset.

    A name like "peer:compix" is the recipe of another system over our voxels and at the settings of
    "high" otherwise, "peer:compix:published" the same with that system's own scale. A name that
    ends in ".toml" is a preset file (`vctgi.preset_file`), such as `vctgi optimize` writes.

    Raises
    ------
    ValueError
        No preset of that name.
    PresetFileError
        A preset file that cannot be read or used.
    """
    if name in PRESETS:
        return PRESETS[name]
    if is_preset_file(name) or name in shipped_presets():
        return _from_file(shipped_presets().get(name, Path(name)))
    if not name.startswith(PEER_PREFIX):
        raise ValueError(
            f"no preset '{name}'; choose one of {', '.join([*PRESETS, *shipped_presets()])}, "
            f"a file that ends in {SUFFIX}, or {PEER_PREFIX} and one of {', '.join(PEERS)}."
        )
    peer, diffuse = find_peer(name)
    return replace(PRESETS["high"], diffuse=diffuse, downsampling=peer.downsampling)


def _from_file(path: Path) -> RenderConfig:
    """Return what a preset file describes; its base is a preset that is no file."""
    file = read_preset_file(path)
    if file.base not in (*PRESETS, *peer_names()):
        raise PresetFileError(
            f"the preset file's base is '{file.base}'",
            str(path),
            f"use one of {', '.join(PRESETS)}",
        )
    return changed_config(preset(file.base), file, path)
