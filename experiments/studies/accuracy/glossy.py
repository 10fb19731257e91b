"""The glossy built-in scene by specular cones alone, and where their marches step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

import reference
import vctgi
from experiments.scenes.glossy_floor import glossy_floor
from experiments.studies.check import StudyContext
from metrics.luminance import luminance
from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.cones import ratio_from_aperture
from vctgi.maths.directions import kronecker_points, offset_from_surface
from vctgi.maths.stub_gaps import as_component
from vctgi.pipeline import PreparedScene
from vctgi.scene.extent import half_extent
from vctgi.scene.records import FilmSample, GBuffer
from vctgi.specular_pipeline import gather_specular
from vctgi.stages.cone_tracing.march import ConeMarchConfig
from vctgi.stages.gbuffer import trace_gbuffer

EDGE = (160, 96)
"""Pixels along an edge, in the whole study and in the quick one."""

PATHS = (512, 128)
"""Paths a pixel of the reference."""

RESOLUTION = 64
"""Voxels along an edge."""

FARTHEST_NEIGHBOUR = 0.15
"""Relative change from pixel to pixel of the distance that cones see to, away from edges."""


@dataclass
class GlossyView:
    """The scene, its lit voxels, and the pixels that its floor fills."""

    edge: int
    prepared: PreparedScene
    volume: VoxelVolume
    config: vctgi.RenderConfig

    def render(self, config: vctgi.RenderConfig, sample_count: int = 1) -> np.ndarray:
        """Light [row, column, rgb] that specular lobes reflect, a mean of samples a pixel."""
        total = np.zeros((self.edge, self.edge, 3))
        for number in range(sample_count):
            gbuffer = self.gbuffer(config, number)
            film = FilmSample(self.edge, number)
            plan = self.prepared.plan
            found = gather_specular(plan, gbuffer, self.volume, config, film=film)
            total += np.array(found, dtype=np.float64).T.reshape(total.shape)
        return total / sample_count

    def gbuffer(self, config: vctgi.RenderConfig, number: int = 0) -> GBuffer:
        """Return what one ray through each pixel meets."""
        pixel = dr.arange(mi.UInt32, self.edge**2)
        place = mi.Point2f(pixel % self.edge, pixel // self.edge)
        place += kronecker_points(dr.opaque(mi.UInt32, number))
        ray, _ = self.prepared.sensor.sample_ray_differential(
            as_component(0.0), as_component(0.5), place / self.edge, mi.Point2f(0.5)
        )
        gbuffer = trace_gbuffer(
            self.prepared.scene,
            ray,
            pixel + mi.UInt32(number * self.edge**2),
            config.gbuffer,
            has_specular=True,
            has_passing=False,
            lobe_kinds=self.prepared.lobe_kinds,
        )
        dr.eval(gbuffer)
        return gbuffer

    def cycles(self, march: ConeMarchConfig) -> tuple[np.ndarray, np.ndarray]:
        """Return steps of the march to what each pixel's cone sees, and where bands can be told.

        Returns
        -------
        tuple
            Steps [row, column], a real number; a mask: glossy, and nothing else next to it.
        """
        gbuffer = self.gbuffer(self.config)
        origin = offset_from_surface(
            gbuffer.position, gbuffer.normal, half_extent(self.prepared.scene)
        )
        si = self.prepared.scene.ray_intersect(mi.Ray3f(origin, gbuffer.specular_axis))
        is_glossy = np.array(gbuffer.is_valid & (dr.max(gbuffer.specular_albedo) > 0.0))
        distance = np.where(is_glossy, np.array(dr.select(si.is_valid(), si.t, 1.0)), 1.0)
        aperture = np.where(is_glossy, np.array(gbuffer.specular_aperture), 1.0)
        steps = steps_to(distance, aperture, march, self.volume.layout.finest_voxel_size)
        shape = (self.edge, self.edge)
        slopes = np.abs(np.gradient(np.log(distance.reshape(shape))))
        mask = is_glossy.reshape(shape) & (sum(slopes) < FARTHEST_NEIGHBOUR)
        inner = mask.copy()
        inner[1:-1] &= mask[2:] & mask[:-2]
        inner[:, 1:-1] &= mask[:, 2:] & mask[:, :-2]
        return steps.reshape(shape), inner


def steps_to(
    distance: np.ndarray, aperture: np.ndarray, march: ConeMarchConfig, voxel_size: float
) -> np.ndarray:
    """Return the steps of a march from its start to a distance, inside one clip level.

    Even steps lead to where the cone is as wide as they are long; from there on they grow with it.
    """
    start = march.start_offset_voxels * voxel_size
    even = march.min_step_voxels * voxel_size
    growth = march.step_ratio * np.vectorize(ratio_from_aperture)(aperture)
    turn = np.maximum(even / growth, start)
    near = (np.minimum(distance, turn) - start) / even
    far = np.log(np.maximum(distance, turn) / turn) / np.log1p(growth)
    steps: np.ndarray = near + far
    return steps


def glossy_view(context: StudyContext, alpha: float, edge: int | None = None) -> GlossyView:
    """Return the scene with a GGX floor of this roughness, `EDGE` pixels wide unless told."""
    edge = EDGE[context.quick] if edge is None else edge

    def prepare() -> GlossyView:
        scene, config = _load(alpha, edge), vctgi.RenderConfig()
        config = replace(config, clipmap=replace(config.clipmap, resolution=RESOLUTION))
        prepared = vctgi.prepare_scene(scene, scene.sensors()[0], config)
        volume = vctgi.light_volume(prepared, config).volume
        return GlossyView(edge, prepared, volume, config)

    return context.once(f"glossy view, {alpha}, {edge}", prepare)


def path_traced_batches(context: StudyContext, alpha: float) -> np.ndarray:
    """Batches [batch, row, column, rgb] of the same light by path tracing."""

    def trace() -> np.ndarray:
        request = reference.ReferenceRequest(
            samples_per_pixel=PATHS[context.quick], batch_count=8, rest_samples_per_pixel=0
        )
        truth = reference.render_reference(
            _load(alpha, EDGE[context.quick]),
            sensor=0,
            request=request,
            cache_directory=None,
            progress=lambda share: context.progress("path tracing", share),
        )
        return truth.batches("indirect_specular").astype(np.float64)

    return context.once(f"glossy truth, {alpha}", trace)


def relative_residual(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(V - R) / (R + 0.05 mean R) of luminance [row, column], means over what is lit."""
    bright = luminance(truth)
    floor = 0.05 * float(bright[bright > 0.0].mean())
    residual: np.ndarray = (luminance(found) - bright) / (bright + floor)
    return residual


def _load(alpha: float, edge: int) -> mi.Scene:
    description = glossy_floor(alpha=alpha)
    film = description["sensor"]["film"]
    film.update(width=edge, height=edge, rfilter={"type": "box"}, component_format="float32")
    scene: mi.Scene = mi.load_dict(description)
    return scene
