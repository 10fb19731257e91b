"""`vctgi reference`: the path-traced truth of a view as a multi-channel EXR file.

Channels: R G B, and for each component `NAME.R` and so on, W m^-2 sr^-1, and `variance_NAME.R`, the
variance of its mean.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import reference
import vctgi
from experiments.errors import InputError
from experiments.frame_files import require_exr, write_channels
from experiments.progress import ProgressReport
from experiments.run import RunOptions, reference_request
from experiments.scenes import LoadedScene, load_scene
from experiments.session import start_mitsuba, writable_file

DEFAULT_MOST_SPP = 1 << 16
"""Paths a pixel that a target may take, if the user says nothing."""


@dataclass(frozen=True, kw_only=True)
class TargetOptions:
    """What is asked of a reference that is rendered until it is good enough."""

    relmse: float
    """Noise of the mean of the picture."""
    most_spp: int | None = None
    """Paths a pixel that are not exceeded; None is `DEFAULT_MOST_SPP`."""
    seed: int = 0
    """Start of all random numbers."""
    cache: Path | None = None
    """Where finished batches are kept."""


def reference_file(
    source: str,
    output: Path,
    resolution: int | None,
    options: RunOptions,
    variant: str | None,
    sensor: int,
) -> str:
    """Render so many paths a pixel to an EXR file; return a line about their noise."""
    loaded = _load(source, output, resolution, variant, sensor)
    with ProgressReport() as progress:
        progress.start_scene(loaded.title, 1, 1)
        truth = reference.render_reference(
            loaded.scene,
            sensor=loaded.sensor_index,
            request=reference_request(options, vctgi.preset(options.preset)),
            cache_directory=options.cache_directory,
            progress=lambda share: progress("path tracing", share),
        )
    return _write(output, truth)


def reference_to_target(
    source: str,
    output: Path,
    resolution: int | None,
    options: TargetOptions,
    variant: str | None,
    sensor: int,
) -> str:
    """Render to an EXR file until the noise is low enough; return a line about it.

    Raises
    ------
    InputError
        The target is none, or needs more paths than are allowed.
    """
    require_exr(output)
    try:
        target = reference.ReferenceTarget(
            relmse=options.relmse,
            most_samples_per_pixel=DEFAULT_MOST_SPP
            if options.most_spp is None
            else options.most_spp,
            scattering_count=vctgi.RenderConfig().scattering_count,
            seed=options.seed,
        )
    except ValueError as error:
        raise InputError(
            what=str(error), where="--target-relmse, --spp, --seed", remedy="give other numbers"
        ) from error
    loaded = _load(source, output, resolution, variant, sensor)
    with ProgressReport() as progress:
        progress.start_scene(loaded.title, 1, 1)
        try:
            truth = reference.render_to_target(
                loaded.scene,
                sensor=loaded.sensor_index,
                target=target,
                cache_directory=options.cache,
                progress=lambda share: progress("path tracing", share),
            )
        except reference.NoisyReferenceError as error:
            raise InputError(
                what=str(error),
                where=loaded.source,
                remedy="raise --spp or --target-relmse; what was rendered is kept",
            ) from error
    return _write(output, truth)


def _load(
    source: str, output: Path, resolution: int | None, variant: str | None, sensor: int
) -> LoadedScene:
    """Load a scene, after all that could be wrong with the file to write."""
    require_exr(output)
    start_mitsuba(variant)
    loaded = load_scene(source, resolution=resolution, sensor_index=sensor)
    writable_file(output)
    return loaded


def _write(output: Path, truth: reference.Reference) -> str:
    """Write components and variances; return a line about their noise."""
    channels = {"": truth.mean("image")}
    for name in truth.components:
        channels[name] = truth.mean(name)
        channels[f"variance_{name}"] = truth.variance_of_mean(name)
    write_channels(output, channels, {"request": asdict(truth.request), "key": truth.key})
    floor = reference.noise_floor(truth)
    noise = (
        f"noise relMSE {floor.value:.2g}, below {floor.upper:.2g} at 95 %: enough for differences "
        f"from {reference.LEAST_FACTOR * floor.upper:.2g}"
        if np.isfinite(floor.value)
        else "no light in the picture"
    )
    return f"{output}: {truth.request.samples_per_pixel} paths a pixel, {noise}"
