"""What is compared: cones by presets, recipes and a grid around "high"; paths; denoised paths."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Final

from vctgi.clipmap.levels import ClipmapConfig
from vctgi.config import PRESETS, RenderConfig, preset
from vctgi.peers import PEER_PREFIX, PEERS, PUBLISHED_SUFFIX
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig
from vctgi.stages.reconstruction.config import ReconstructionConfig

OURS, GRID, RECIPES, PATHS, DENOISED = (
    "presets",
    'grid around "high"',
    "recipes of other systems",
    "path tracing",
    "denoised path tracing",
)
"""Families of methods."""

FAMILIES: Final = (OURS, GRID, RECIPES, PATHS, DENOISED)

PRESET_NAMES: Final = tuple(name for name, config in PRESETS.items() if config.mode != "ambient")
"""Ours that render light: ambient occlusion has no error to compare."""

MOST_PATHS = {True: 256, False: 4096}
"""Samples a pixel of path tracing at most, in the quick study and in the whole one."""
DENOISED_PATHS = {True: (1, 4, 16), False: (1, 2, 4, 8, 16, 64, 256)}
"""Samples a pixel that are denoised, in the quick study and in the whole one."""

QUICK_RESOLUTION = 32
"""Voxels along an edge of a level in the quick study."""

HIGH = "high"

CORNERS: Final = ((6, 32), (1, 16), (64, 128))
"""Cones, rays for each that traces cones, voxels along an edge: few and many, all combinations."""


@dataclass(frozen=True, kw_only=True)
class Method:
    """One way to make a picture.

    Attributes
    ----------
    name
        Unique.
    family
        One of `FAMILIES`.
    config
        Of cones; None: paths.
    samples_per_pixel
        Of paths, and of camera rays of cones.
    gain
        Factor on the diffuse light that cones gather.
    renders_like
        The method that this one has its picture and times from, but for the gain; "" for itself.
    is_on_floor
        Whether it differs from "high" in nothing but the samples a pixel.
    """

    name: str
    family: str
    config: RenderConfig | None = None
    samples_per_pixel: int
    gain: float = 1.0
    renders_like: str = ""
    is_on_floor: bool = False


def path_name(samples: int) -> str:
    """Return the name of path tracing with so many samples a pixel."""
    return f"paths, {samples} spp"


def methods(*, quick: bool) -> list[Method]:
    """Return all that are compared."""
    return [*cone_methods(quick=quick), *path_methods(quick=quick)]


def path_methods(*, quick: bool) -> list[Method]:
    """Return path tracing at powers of two, and denoised."""
    most = MOST_PATHS[quick]
    counts = [1 << power for power in range(most.bit_length())]
    return [
        *(Method(name=path_name(n), family=PATHS, samples_per_pixel=n) for n in counts),
        *(
            Method(name=f"denoised, {n} spp", family=DENOISED, samples_per_pixel=n)
            for n in DENOISED_PATHS[quick]
        ),
    ]


def cone_methods(*, quick: bool) -> list[Method]:
    """Return presets, recipes of other systems, and the grid around "high"."""
    resize = _small if quick else _as_it_is
    found = [
        _cones(name, OURS, resize(preset(name)), is_on_floor=name == HIGH) for name in PRESET_NAMES
    ]
    if quick:
        high = _small(preset(HIGH))
        found.append(_cones("peer:classic", RECIPES, _small(preset("peer:classic"))))
        return found + [_with_samples(high, count) for count in (1, 2, 8)]
    return [*found, *_grid(preset(HIGH)), *_recipes()]


def _as_it_is(config: RenderConfig) -> RenderConfig:
    return config


def _small(config: RenderConfig) -> RenderConfig:
    return replace(config, clipmap=replace(config.clipmap, resolution=QUICK_RESOLUTION))


def _cones(name: str, family: str, config: RenderConfig, *, is_on_floor: bool = False) -> Method:
    return Method(
        name=name,
        family=family,
        config=config,
        samples_per_pixel=config.samples_per_pixel,
        is_on_floor=is_on_floor,
    )


def _with_samples(high: RenderConfig, count: int) -> Method:
    return _cones(
        f"high, {count} spp", GRID, replace(high, samples_per_pixel=count), is_on_floor=True
    )


def _grid(high: RenderConfig) -> list[Method]:
    """Return "high" with one parameter at a time at other values, then with three at once."""

    def diffuse(cones: DiffuseConesConfig) -> RenderConfig:
        return replace(high, diffuse=cones)

    varied: dict[str, RenderConfig] = {}
    for count in (6, 32, 64):
        varied[f"high, {count} cones"] = diffuse(replace(high.diffuse, cone_count=count))
    for sparsity in (1, 4, 16):
        varied[f"high, {_traced(sparsity)}"] = replace(
            high, reconstruction=ReconstructionConfig(sparsity=sparsity)
        )
    for reach in (0.0, 1.5, 6.0):
        cones = replace(high.diffuse, near_field_voxels=reach)
        varied[f"high, near field {reach:g}"] = diffuse(cones)
    for step in (0.25, 1.0):
        march = replace(high.diffuse.march, step_ratio=step)
        varied[f"high, step {step:g}"] = diffuse(replace(high.diffuse, march=march))
    for resolution in (32, 64):
        varied[f"high, {resolution}^3 voxels"] = replace(
            high, clipmap=ClipmapConfig(resolution=resolution)
        )
    for count, sparsity, resolution in product(*CORNERS):
        name = f"high, {count} cones, {_traced(sparsity)}, {resolution}^3 voxels"
        varied[name] = replace(
            high,
            diffuse=replace(high.diffuse, cone_count=count),
            reconstruction=ReconstructionConfig(sparsity=sparsity),
            clipmap=ClipmapConfig(resolution=resolution),
        )
    found = [_cones(name, GRID, config) for name, config in varied.items()]
    return found + [_with_samples(high, count) for count in (1, 2, 8, 16, 32)]


def _traced(sparsity: int) -> str:
    return "every ray" if sparsity == 1 else f"every {sparsity}th ray"


def _recipes() -> list[Method]:
    """Return other systems' recipes, with and without their own scale, which costs no time."""
    found = []
    for name, peer in PEERS.items():
        plain = _cones(PEER_PREFIX + name, RECIPES, preset(PEER_PREFIX + name))
        found.append(plain)
        if peer.published_gain != 1.0:
            found.append(
                replace(
                    plain,
                    name=plain.name + PUBLISHED_SUFFIX,
                    gain=peer.published_gain,
                    renders_like=plain.name,
                )
            )
    return found
