"""`vctgi render`: one picture as a multi-channel EXR file.

Channels: R G B, and `NAME.R` and so on for each component in W m^-2 sr^-1; a frame also has albedo,
`normal.X`, `depth.Z`. In the mode "ambient" a frame has no light but `ambient.Y`, and R G B is what
even light of radiance 1 from all around would show: albedo times `ambient.Y`.
"""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import OpenEXR

import vctgi
from experiments.errors import InputError
from experiments.progress import ProgressReport
from experiments.run import component_images, surface_images
from experiments.scenes import LoadedScene, load_scene
from experiments.session import find_preset, start_mitsuba, writable_file, writable_folder
from experiments.voxel_folder import write_voxel_folder
from vctgi.pipeline import Frame

AXES = {"normal": "XYZ", "depth": "Z", "ambient": "Y"}
"""Channel suffixes of what is not a colour."""


DEBUG_NAMES = ("voxels",)
"""Intermediate data that a frame can be written with."""


def render_frame_file(  # noqa: PLR0913 - the options of a command
    source: str,
    output: Path,
    preset: str,
    resolution: int | None,
    spp: int,
    seed: int,
    variant: str | None,
    sensor: int,
    debug: str | None = None,
    keep: tuple[str, ...] = (),
) -> list[str]:
    """Render a frame by cones, with Mitsuba's direct light, to an EXR file.

    Returns
    -------
    list of str
        What was written beside it, and what the frame says of itself, a line each.

    Raises
    ------
    InputError
        Bad input, such as a `debug` that is none of `DEBUG_NAMES`.
    """
    find_preset(preset)
    require_exr(output)
    if debug is not None and debug not in DEBUG_NAMES:
        raise InputError(
            what=f"no debug pictures of '{debug}'",
            where="--debug",
            remedy=f"use {', '.join(DEBUG_NAMES)}",
        )
    start_mitsuba(variant)
    config = replace(vctgi.preset(preset), keep=keep)
    is_ambient = config.mode == "ambient"
    loaded = load_scene(
        source, resolution=resolution, sensor_index=sensor, needs_light=not is_ambient
    )
    writable_file(output)
    folder = output.with_suffix(f".{debug}")
    if debug is not None:
        writable_folder(folder)
    camera = loaded.scene.sensors()[loaded.sensor_index]
    with ProgressReport() as progress:
        progress.start_scene(loaded.title, 1, 1)
        progress("cone tracing", 0.0)
        prepared = vctgi.prepare_scene(loaded.scene, camera, config)
        volume = vctgi.light_volume(prepared, config).volume
        frame = vctgi.render_frame(prepared, volume, config, seed=seed)
        if is_ambient:
            channels = _ambient_channels(frame)
        else:
            progress("direct light", 0.0)
            channels = _light_channels(frame, _direct_light(loaded, spp, seed))
        lines = _reconstruction_lines(config, frame)
        if debug is not None:
            progress("pictures of voxels", 0.0)
            lines += write_voxel_folder(
                prepared, volume, config.voxelization, f"Voxels of {loaded.title}", folder
            )
    channels |= surface_images(frame)
    write_channels(output, channels, {"config": asdict(config), "scene": loaded.name})
    return lines


def _light_channels(frame: Frame, direct: np.ndarray) -> dict[str, np.ndarray]:
    """Return the picture and its components."""
    components = component_images(frame)
    image = direct + components.pop("indirect")
    return {"": image, "direct": direct, **components}


def _ambient_channels(frame: Frame) -> dict[str, np.ndarray]:
    """Return ambient occlusion, and what even light of radiance 1 would show."""
    assert frame.ambient is not None, 'a frame of the mode "ambient" has ambient occlusion'
    ambient = np.array(frame.ambient)
    return {"": np.array(frame.albedo) * ambient, "ambient": ambient[..., 0]}


def _reconstruction_lines(config: vctgi.RenderConfig, frame: Frame) -> list[str]:
    """Say how many rays traced cones though they were not among those chosen to."""
    sparsity = config.reconstruction.sparsity
    if sparsity == 1:
        return []
    return [
        f"cones of every {sparsity}th pixel; {frame.refined_share:.2%} of the camera rays found no "
        "neighbour on their surface and traced cones too"
    ]


def require_exr(output: Path) -> None:
    """Refuse a name that promises another format."""
    if output.suffix.lower() != ".exr":
        raise InputError(
            what="frames and references are OpenEXR files", where=str(output), remedy="name it .exr"
        )


def _direct_light(loaded: LoadedScene, spp: int, seed: int) -> np.ndarray:
    """Emission and direct light by Mitsuba, [height, width, 3]."""
    import mitsuba as mi

    integrator = mi.load_dict({"type": "direct"})
    image = mi.render(
        loaded.scene,
        sensor=loaded.sensor_index,
        integrator=integrator,
        spp=spp,
        seed=mi.UInt32(seed),
    )
    return np.array(image)[..., :3]


def write_channels(
    output: Path, images: dict[str, np.ndarray], attributes: dict[str, object]
) -> None:
    """Write arrays [height, width, 3] or [height, width] as float32 channels of one EXR file.

    The file appears only when it is whole.
    """
    channels = {}
    for name, image in images.items():
        prefix = f"{name}." if name else ""
        values = np.asarray(image, np.float32)
        suffixes = AXES.get(name, "RGB")
        planes = [values] if values.ndim == 2 else [values[..., i] for i in range(3)]
        for suffix, plane in zip(suffixes, planes, strict=True):
            channels[prefix + suffix] = np.ascontiguousarray(plane)
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        **{f"vctgi:{key}": json.dumps(value) for key, value in attributes.items()},
    }
    partial = output.with_name(f".{output.name}.partial")
    OpenEXR.File(header, channels).write(str(partial))
    partial.replace(output)
