"""Pictures of indirect diffuse light with some stages exact, in independent renderings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.attribution.gathering import Gatherer
from experiments.studies.attribution.stages import Exact
from experiments.studies.attribution.voxels import exact_light
from vctgi.clipmap.storage import StorageConfig, VoxelVolume, pack_volume
from vctgi.config import RenderConfig
from vctgi.frame_pipeline import SEED_STRIDE, visible_points
from vctgi.maths.directions import kronecker_points, random_bits, random_unit
from vctgi.pipeline import light_volume, voxelize_scene
from vctgi.prepared import PreparedScene
from vctgi.stages.composite import composite
from vctgi.stages.downsampling import downsample
from vctgi.stages.reconstruction.interpolation import interpolate, lone_rays, refine, trace_sparse
from vctgi.stages.reconstruction.sparse_pixels import SparseGrid

EXACT_STORAGE = StorageConfig()
"""32-bit floats in six directions."""

PLACE_STREAM = 1200
"""First hash stream of random places in a pixel."""


@dataclass(frozen=True)
class Volumes:
    """Voxels of a scene, by light maps and with exact light, in both storage formats.

    Attributes
    ----------
    by_key
        By whether storage and light are exact.
    """

    by_key: dict[tuple[bool, bool], VoxelVolume]

    def of(self, exact: Exact) -> VoxelVolume:
        """Return those that a renderer with some stages exact reads."""
        return self.by_key[exact.storage, exact.light]


def make_volumes(prepared: PreparedScene, config: RenderConfig) -> Volumes:
    """Light the voxels of a scene in all ways that are asked for."""
    voxels = voxelize_scene(prepared, config)
    emittance = exact_light(prepared, voxels.opacity, config.scattering_count - 1)
    merged, lit = downsample(voxels.opacity, emittance, config.downsampling)
    assert lit is not None, "downsampling keeps the emittance it is given"
    by_key: dict[tuple[bool, bool], VoxelVolume] = {}
    for is_exact, storage in ((False, config.storage), (True, EXACT_STORAGE)):
        if is_exact and _is_exact(config.storage):
            # Voxels of a large scene take gigabytes.
            by_key |= {(True, light): by_key[False, light] for light in (False, True)}
            continue
        maps = light_volume(prepared, replace(config, storage=storage), voxels=voxels)
        by_key[is_exact, False] = maps.volume
        by_key[is_exact, True] = pack_volume(merged, lit, storage)
    return Volumes(by_key)


def _is_exact(storage: StorageConfig) -> bool:
    """Whether voxels are stored exactly; without a GPU, "auto" is single precision."""
    is_gpu = dr.backend_v(mi.Float) == dr.JitBackend.CUDA
    return storage == EXACT_STORAGE or (storage == StorageConfig(format="auto") and not is_gpu)


def that_matters(exact: Exact, config: RenderConfig) -> Exact:
    """Return the same renderer without the stages that change nothing in it.

    What voxels hold does not matter to a path tracer, nor does their format if it is exact already;
    random places in a pixel leave nothing to interpolate.
    """
    if exact.pixels:
        exact = replace(exact, dense=False)
    if exact.visibility and exact.radiance:
        return replace(exact, light=False, storage=False, width=False)
    if _is_exact(config.storage):
        return replace(exact, storage=False)
    return exact


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much of each rendering is averaged, so that intervals say something.

    Attributes
    ----------
    batch_count
        Independent renderings, >= 5.
    marched_rays, traced_rays
        Camera rays a pixel with exact pixels, with and without a march.
    sparse_repeats
        Rays a cone with sparse pixels and any exact ray, of which few are traced.
    """

    batch_count: int
    marched_rays: int
    traced_rays: int
    sparse_repeats: int


def render_batches(
    prepared: PreparedScene,
    volumes: Volumes,
    config: RenderConfig,
    exact: Exact,
    effort: Effort,
    progress: Callable[[float], None],
) -> np.ndarray:
    """Return indirect diffuse light [batch, y, x, rgb], W m^-2 sr^-1, in independent renderings."""
    gather = Gatherer(
        scene=prepared.scene,
        volume=volumes.of(exact),
        cones=config.diffuse,
        scattering_count=config.scattering_count - 1,
        exact=exact,
        repeat_count=1 if exact.pixels else effort.sparse_repeats,
    )
    rays = effort.traced_rays if exact.visibility else effort.marched_rays
    found = []
    for batch in range(effort.batch_count):
        found.append(_render(prepared, config, gather, batch, rays))
        progress((batch + 1) / effort.batch_count)
    return np.array(found)


def _render(
    prepared: PreparedScene, config: RenderConfig, gather: Gatherer, seed: int, ray_count: int
) -> np.ndarray:
    """One rendering: `vctgi.render_frame` with another way to gather, or with exact pixels."""
    width, height = (int(n) for n in prepared.sensor.film().crop_size())
    has_exact_pixels = gather.exact.pixels
    count = ray_count if has_exact_pixels else config.samples_per_pixel
    pixel = dr.arange(mi.UInt32, width * height)
    total = dr.zeros(mi.Color3f, width * height)
    traced = None
    for number in range(count):
        stream = dr.opaque(mi.UInt32, number + seed * SEED_STRIDE)
        sample_index = random_bits(pixel, stream)
        corner = mi.Point2f(pixel % width, pixel // width)
        if has_exact_pixels:
            u, v = (random_unit(sample_index, PLACE_STREAM + i) for i in range(2))
            place = corner + mi.Point2f(u, v)
        else:
            place = corner + kronecker_points(dr.opaque(mi.UInt32, number))
        gbuffer = visible_points(prepared, config, place, sample_index)
        seeded = partial(gather, seed=seed * SEED_STRIDE + number)
        if has_exact_pixels or gather.exact.dense or config.reconstruction.sparsity == 1:
            incident = seeded(gbuffer)
        else:
            if traced is None or not config.reconstruction.is_traced_once:
                edge = config.reconstruction.edge
                grid = SparseGrid(width=width, height=height, edge=edge, layer=number)
                traced = trace_sparse(gbuffer, place, grid, seeded)
            near = interpolate(gbuffer, place, traced, config.reconstruction)
            incident = refine(gbuffer, near.light, lone_rays(near), seeded)
        total += composite(gbuffer, incident, None).diffuse
        dr.eval(total)
    picture = np.array(total, dtype=np.float64).T.reshape(height, width, 3)
    return np.asarray(picture / count)
