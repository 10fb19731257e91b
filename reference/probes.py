"""Irradiance at points in space with a normal, so that a comparison need not go through a camera.

What the light carries is Mitsuba's at every step: `direct` is its emitter sampling, shadow ray
included; `indirect` is its path integrator along cosine-distributed rays, less the emission which
these rays meet. A ray of that distribution carries radiance L with density cos / pi, so pi times
the mean of L is the irradiance; the sensor that Mitsuba has for this, `irradiancemeter`, does the
same, but only on shapes of the scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike

from reference.components import light_scattered
from reference.passes import LANES_PER_PASS, pass_seed, samples_per_pass

LEAST_BATCHES: Final = 2
"""A variance needs two batches."""
UNIT_TOLERANCE: Final = 1e-3
"""By how much the length of a normal may differ from one."""
_PROBE_STREAM: Final = 2
UNLIMITED: Final = -1
"""Scattering count that stands for any number."""


@dataclass(kw_only=True)
class ProbeIrradiance:
    """Irradiance at probes, as batches with independent seeds.

    Attributes
    ----------
    components
        `direct` and `indirect`: float32 `[batch, probe, rgb]`, W m^-2.
    samples
        Rays of a probe over all batches.
    """

    components: dict[str, np.ndarray]
    samples: int

    def batches(self, name: str) -> np.ndarray:
        """Batches of `direct`, `indirect` or their sum `total`: `[batch, probe, rgb]`, W m^-2.

        Raises
        ------
        ValueError
            For another name.
        """
        if name == "total":
            total: np.ndarray = self.components["direct"] + self.components["indirect"]
            return total
        if name not in self.components:
            raise ValueError(
                f"ProbeIrradiance.batches: no component named {name!r}, there are "
                f"{[*self.components, 'total']}."
            )
        return self.components[name]

    def mean(self, name: str) -> np.ndarray:
        """Mean over the batches: float64 `[probe, rgb]`, W m^-2."""
        return np.asarray(self.batches(name).mean(axis=0, dtype=np.float64))

    def variance_of_mean(self, name: str) -> np.ndarray:
        """Unbiased variance of `mean`: float64 `[probe, rgb]`, W^2 m^-4."""
        batches = self.batches(name)
        variance: np.ndarray = batches.var(axis=0, ddof=1, dtype=np.float64) / len(batches)
        return variance


def probe_irradiance(
    scene: mi.Scene,
    points: ArrayLike,
    normals: ArrayLike,
    *,
    samples: int,
    batch_count: int = 8,
    scattering_count: int = 2,
    seed: int = 0,
) -> ProbeIrradiance:
    """Irradiance that small plane probes receive on the side of their normals.

    Parameters
    ----------
    scene
        A loaded scene of variant `llvm_ad_rgb` or `cuda_ad_rgb`.
    points
        World points `[probe, 3]`, on surfaces or in free space; rays start a few rounding errors
        off them, along the normals.
    normals
        Unit normals `[probe, 3]`.
    samples
        Rays of a probe over all batches, a multiple of `batch_count`.
    batch_count
        Batches with independent seeds, at least 2.
    scattering_count
        k: scatterings between emitter and eye if a surface lay at the probe, as in
        `ReferenceRequest`: `direct` is light that nothing scattered before, `indirect` what 1 ..
        k - 1 surfaces did; at least 1, or -1 for any number.
    seed
        Start of every random number, >= 0.

    Raises
    ------
    ValueError
        If the variant is not supported or an argument is not as above.
    RuntimeError
        If a sample is not finite.
    """
    at, normal = _checked_probes(points, normals)
    _check_numbers(samples, batch_count, scattering_count, seed)
    probe_count = len(at)
    batch_samples = samples // batch_count
    components: dict[str, list[np.ndarray]] = {"direct": [], "indirect": []}
    for batch in range(batch_count):
        pass_samples = samples_per_pass(batch_samples, probe_count, str(mi.variant()))
        pass_count = batch_samples // pass_samples
        sums = {name: np.zeros((probe_count, 3)) for name in components}
        for number in range(pass_count):
            pass_ = pass_seed(seed, batch, number, _PROBE_STREAM)
            for name, values in _pass(scene, at, normal, pass_samples, scattering_count, pass_):
                sums[name] += values
        for name, total in sums.items():
            _check_finite(name, total)
            components[name].append((total / batch_samples).astype(np.float32))
    return ProbeIrradiance(
        components={name: np.stack(batches) for name, batches in components.items()},
        samples=samples,
    )


def _pass(
    scene: mi.Scene,
    points: np.ndarray,
    normals: np.ndarray,
    samples: int,
    scattering_count: int,
    seed: int,
) -> list[tuple[str, np.ndarray]]:
    """Sum `[probe, rgb]` over so many samples of each probe, by component."""
    lane_count = len(points) * samples
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, lane_count)
    probe = dr.arange(mi.UInt32, lane_count) // dr.opaque(mi.UInt32, samples)
    position = dr.gather(mi.Point3f, mi.Point3f(np.ascontiguousarray(points.T)), probe)
    normal = dr.gather(mi.Vector3f, mi.Vector3f(np.ascontiguousarray(normals.T)), probe)
    # Mitsuba offsets the rays of a surface interaction along its normal
    si = dr.zeros(mi.SurfaceInteraction3f, lane_count)
    # Any finite distance makes the interaction valid
    si.t = sampler.next_1d()
    si.p, si.n, si.sh_frame = position, mi.Normal3f(normal), mi.Frame3f(normal)
    everywhere = si.is_valid()

    sample, weight = scene.sample_emitter_direction(si, sampler.next_2d(), True, everywhere)
    cosine = si.to_local(sample.d).z
    direct = dr.select(cosine > 0.0, weight * cosine, mi.Spectrum(0.0))

    direction = si.sh_frame.to_world(mi.warp.square_to_cosine_hemisphere(sampler.next_2d()))
    ray = si.spawn_ray(direction)
    indirect = dr.pi * light_scattered(scattering_count, scene, sampler, ray, everywhere)
    sums = [
        # A colour known while tracing, such as a black scene's, is one lane wide
        [dr.block_sum(channel + dr.zeros(mi.Float, lane_count), samples) for channel in light]
        for light in (direct, indirect)
    ]
    dr.eval(sums)
    arrays = [np.stack([channel.numpy() for channel in light], axis=-1) for light in sums]
    return list(zip(("direct", "indirect"), arrays, strict=True))


def _checked_probes(points: ArrayLike, normals: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return points and unit normals as float32 `[probe, 3]`, or refuse them."""
    at, normal = (np.asarray(each, np.float32) for each in (points, normals))
    if at.ndim != 2 or at.shape[1:] != (3,) or at.shape != normal.shape or not len(at):
        raise ValueError(
            f"probe_irradiance: points and normals must both have the shape [probe, 3] with at "
            f"least one probe, got {at.shape} and {normal.shape}."
        )
    if not (np.isfinite(at).all() and np.isfinite(normal).all()):
        raise ValueError("probe_irradiance: points and normals must be finite; drop those probes.")
    length = np.linalg.norm(normal, axis=1)
    if (np.abs(length - 1.0) > UNIT_TOLERANCE).any():
        raise ValueError(
            f"probe_irradiance: normals must have unit length, one has {length.min():g} and one "
            f"{length.max():g}; divide them by their lengths."
        )
    return at, normal


def _check_numbers(samples: int, batch_count: int, scattering_count: int, seed: int) -> None:
    if mi.variant() not in LANES_PER_PASS:
        raise ValueError(
            f"probe_irradiance: variant {mi.variant()!r} is not supported; set one of "
            f"{list(LANES_PER_PASS)} with mi.set_variant and load the scene again."
        )
    if batch_count < LEAST_BATCHES:
        raise ValueError(f"probe_irradiance: batch_count must be at least 2, got {batch_count}.")
    if samples < batch_count or samples % batch_count:
        raise ValueError(
            f"probe_irradiance: samples must be a multiple of batch_count = {batch_count}, got "
            f"{samples}."
        )
    if scattering_count < 1 and scattering_count != UNLIMITED:
        raise ValueError(
            f"probe_irradiance: scattering_count must be at least 1, or {UNLIMITED} for any "
            f"number, got {scattering_count}."
        )
    if seed < 0:
        raise ValueError(f"probe_irradiance: seed must be at least 0, got {seed}.")


def _check_finite(name: str, sums: np.ndarray) -> None:
    bad = ~np.isfinite(sums).all(axis=-1)
    if bad.any():
        raise RuntimeError(
            f"probe_irradiance: component {name!r} has samples that are not finite at "
            f"{int(bad.sum())} probes, the first is number {int(np.argmax(bad))}: look for an "
            "emitter, texture or vertex near it that is infinite or NaN."
        )
