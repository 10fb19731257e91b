"""Denoised path tracing: what a user would choose instead of cones. A competitor, never a truth.

Few paths a pixel by Mitsuba's `path`, then Open Image Denoise (the extra `[denoise]`, pyoidn), with
the albedo and the normal of the first surface as guides. A denoiser trades noise for bias that no
variance shows, so nothing here returns a `Reference`.
"""

from __future__ import annotations

import importlib
import time
from dataclasses import dataclass
from typing import Final, Protocol, cast

import mitsuba as mi
import numpy as np

from reference.batch_run import check_scene

_GUIDES: Final = "albedo:albedo,normal:sh_normal"


class DenoiserMissingError(RuntimeError):
    """Open Image Denoise cannot be used here; the message is one line with a remedy."""


@dataclass(kw_only=True)
class DenoisedFrame:
    """A picture by few paths, before and after denoising.

    Attributes
    ----------
    image, noisy
        float32 `[y, x, rgb]`, W m^-2 sr^-1.
    albedo, normal
        Guides, float32 `[y, x, 3]`: diffuse reflectance in [0, 1]; world space in [-1, 1]. Means
        over the pixel's rays.
    render_seconds, denoise_seconds
        Wall time of the path tracer, and of the filter. The first picture compiles kernels.
    """

    image: np.ndarray
    noisy: np.ndarray
    albedo: np.ndarray
    normal: np.ndarray
    render_seconds: float
    denoise_seconds: float


class _OpenImageDenoise(Protocol):
    """What is used of the module pyoidn."""

    def denoise(
        self, color: np.ndarray, *, albedo: np.ndarray, normal: np.ndarray, hdr: bool
    ) -> np.ndarray:
        """Return the picture with less noise."""


def render_denoised(
    scene: mi.Scene,
    *,
    sensor: int = 0,
    samples_per_pixel: int,
    scattering_count: int | None = None,
    seed: int = 0,
) -> DenoisedFrame:
    """Path trace few samples and denoise them.

    Parameters
    ----------
    scene
        A loaded scene of variant `llvm_ad_rgb` or `cuda_ad_rgb`. Its film's filter should be a box:
        a wider one correlates the noise of neighbouring pixels, which the denoiser then keeps.
    sensor
        Index into the scene's sensors.
    samples_per_pixel
        Paths a pixel, >= 1.
    scattering_count
        Most surface scatterings, >= 0; None for any number.
    seed
        Start of every random number, >= 0.

    Raises
    ------
    DenoiserMissingError
        pyoidn is not installed, or does not work here; nothing has been rendered then.
    ValueError
        For a variant, sensor or number that is not as above.
    """
    check_scene(scene, sensor)
    if samples_per_pixel < 1:
        raise ValueError(f"samples_per_pixel must be at least 1, got {samples_per_pixel}.")
    if scattering_count is not None and scattering_count < 0:
        raise ValueError(f"scattering_count must be None or at least 0, got {scattering_count}.")
    denoiser = _open_image_denoise()
    max_depth = -1 if scattering_count is None else scattering_count + 1
    integrator = mi.load_dict(
        {
            "type": "aov",
            "aovs": _GUIDES,
            "path": {"type": "path", "max_depth": max_depth},
        }
    )
    start = time.perf_counter()
    rendered = np.array(
        mi.render(
            scene,
            sensor=sensor,
            integrator=integrator,
            spp=samples_per_pixel,
            seed=mi.UInt32(seed),
        )
    )
    rendered_at = time.perf_counter()
    # The guides are the last channels; a film with an alpha channel has it before them
    noisy, albedo, normal = (
        np.ascontiguousarray(rendered[..., channels], dtype=np.float32)
        for channels in (slice(0, 3), slice(-6, -3), slice(-3, None))
    )
    image = denoiser.denoise(noisy, albedo=albedo, normal=normal, hdr=True)
    return DenoisedFrame(
        image=image,
        noisy=noisy,
        albedo=albedo,
        normal=normal,
        render_seconds=rendered_at - start,
        denoise_seconds=time.perf_counter() - rendered_at,
    )


def denoise(noisy: np.ndarray, *, albedo: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Denoise linear light of few paths.

    Parameters
    ----------
    noisy, albedo, normal
        float32 `[y, x, 3]`, as in `DenoisedFrame`.

    Raises
    ------
    DenoiserMissingError
        pyoidn is not installed, or does not work here.
    """
    return _open_image_denoise().denoise(noisy, albedo=albedo, normal=normal, hdr=True)


def _open_image_denoise() -> _OpenImageDenoise:
    """Import pyoidn."""
    try:
        return cast(_OpenImageDenoise, importlib.import_module("pyoidn"))
    except (ImportError, OSError) as error:
        raise DenoiserMissingError(
            f"denoised path tracing needs Open Image Denoise, which cannot be loaded ({error}): "
            "install the extra, pip install 'vctgi[denoise]'."
        ) from error
