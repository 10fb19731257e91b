"""Indirect light by paths, alone: the competitor, with the transport of the reference.

Every ray, BSDF and emitter is Mitsuba's; direct light is left out, as it is of frames by cones.
A pass draws the first hit and its BSDF sample, and `path` from there, less the emission met.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

import reference
from reference.components import light_scattered
from reference.passes import LANES_PER_PASS, pass_seed, samples_per_pass

STREAM = 7
"""Of the seeds, so that no path is one of the reference's."""


@dataclass
class PathFrame:
    """A picture by paths.

    Attributes
    ----------
    indirect
        Radiance, on the device or as it was denoised.
    host_seconds
        Time of the denoiser, which the history of kernels does not know.
    """

    indirect: mi.Color3f | np.ndarray
    host_seconds: float = 0.0

    def image(self, height: int, width: int) -> np.ndarray:
        """Return it as [row, column, rgb]."""
        if isinstance(self.indirect, np.ndarray):
            return self.indirect
        return as_image(self.indirect, height, width)


def as_image(values: mi.Color3f | mi.Vector3f, height: int, width: int) -> np.ndarray:
    """Return one value a pixel as [row, column, channel]."""
    return np.array(values, dtype=np.float32).T.reshape(height, width, 3)


@dataclass(frozen=True, kw_only=True)
class PathTracer:
    """What is traced.

    Attributes
    ----------
    scene, sensor
        The view.
    scattering_count
        Most surface scatterings between emitter and eye, >= 2.
    """

    scene: mi.Scene
    sensor: mi.Sensor
    scattering_count: int

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns of the picture."""
        width, height = (int(n) for n in self.sensor.film().crop_size())
        return height, width

    def frame(self, samples: int, seed: int) -> PathFrame:
        """Trace paths through all pixels."""
        indirect, _, _ = self._trace(samples, seed, has_guides=False)
        return PathFrame(indirect)

    def denoised(self, samples: int, seed: int) -> PathFrame:
        """Trace paths, and albedo and normals of what they meet first, and denoise the light.

        Raises
        ------
        DenoiserMissingError
            Open Image Denoise cannot be used here.
        """
        planes = self._trace(samples, seed, has_guides=True)
        noisy, albedo, normal = (as_image(each, *self.size) for each in planes)
        start = time.perf_counter()
        image = reference.denoise(noisy, albedo=albedo, normal=normal)
        return PathFrame(image, time.perf_counter() - start)

    def _trace(
        self, samples: int, seed: int, *, has_guides: bool
    ) -> tuple[mi.Color3f, mi.Color3f, mi.Vector3f]:
        """Return mean radiance of all pixels, mean albedo and mean normal."""
        height, width = self.size
        count = samples_per_pass(samples, width * height, str(mi.variant()))
        passes = samples // count
        lanes = width * height * count
        assert lanes <= max(LANES_PER_PASS[str(mi.variant())], width * height), "one pass fits"
        total = [dr.zeros(mi.Float, width * height) for _ in range(9)]
        for number in range(passes):
            sampler = mi.load_dict({"type": "independent"})
            sampler.seed(pass_seed(seed, samples, number, STREAM), lanes)
            pixel = dr.arange(mi.UInt32, lanes) // dr.opaque(mi.UInt32, count)
            planes = self._sample(sampler, pixel, has_guides=has_guides)
            dr.eval(planes)
            for index, plane in enumerate(planes):
                total[index] += dr.block_sum(plane, count) / dr.opaque(mi.Float, float(samples))
            dr.eval(total)
        return mi.Color3f(*total[:3]), mi.Color3f(*total[3:6]), mi.Vector3f(*total[6:])

    def _sample(self, sampler: mi.Sampler, pixel: mi.UInt32, *, has_guides: bool) -> list[mi.Float]:
        """Return one sample of each lane's pixel, a plane for each channel."""
        ray, importance = self._camera_ray(sampler, pixel)
        si = self.scene.ray_intersect(ray)
        bsdf = si.bsdf(ray)
        sample, weight = bsdf.sample(
            mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d(), si.is_valid()
        )
        weight = dr.select(si.is_valid() & (sample.pdf > 0.0), importance * weight, 0.0)
        active = dr.any(weight != 0.0)
        sent_on = si.spawn_ray(si.to_world(sample.wo))
        incident = light_scattered(self.scattering_count, self.scene, sampler, sent_on, active)
        found = [*dr.select(active, weight * incident, mi.Spectrum(0.0))]
        if has_guides:
            albedo = dr.select(si.is_valid(), bsdf.eval_diffuse_reflectance(si), 0.0)
            found += [*albedo, *dr.select(si.is_valid(), si.sh_frame.n, 0.0)]
        lanes = dr.width(pixel)
        return [mi.Float(each) + dr.zeros(mi.Float, lanes) for each in found]

    def _camera_ray(
        self, sampler: mi.Sampler, pixel: mi.UInt32
    ) -> tuple[mi.RayDifferential3f, mi.Spectrum]:
        height, width = self.size
        row = pixel // dr.opaque(mi.UInt32, width)
        column = pixel - row * dr.opaque(mi.UInt32, width)
        place = (mi.Point2f(column, row) + sampler.next_2d()) / mi.Point2f(width, height)
        aperture = sampler.next_2d() if self.sensor.needs_aperture_sample() else mi.Point2f(0.5)
        shutter = self.sensor.shutter_open_time()
        moment = self.sensor.shutter_open() + sampler.next_1d() * shutter
        return self.sensor.sample_ray_differential(moment, sampler.next_1d(), place, aperture)
