"""Storage formats: bytes, errors of values, what they do to a picture, and time of reading them.

Everything is compared with the same voxels in single precision, so nothing but storage differs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.scenes.loading import load_scene
from experiments.studies.check import Check, Measured, StudyContext, mean_of
from metrics.luminance import luminance
from metrics.squared_error import EXPOSURE_INVARIANT_SHARE
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.clipmap.sampling import read_medium
from vctgi.clipmap.storage import (
    CODES,
    SCALED_FORMATS,
    EmittanceClipmap,
    OpacityClipmap,
    StorageConfig,
    VoxelVolume,
    pack_volume,
)
from vctgi.clipmap.texture import TextureTexels
from vctgi.clipmap.unpacking import unpack_level
from vctgi.config import RenderConfig, preset
from vctgi.pipeline import PreparedScene, light_volume, prepare_scene, render_frame

SCENE = "cornell_box"

RESOLUTION = 64
"""Voxels along an edge of the level."""

SMALLEST_COMPACT_BYTES, LARGEST_COMPACT_BYTES = 16.0, 32.0
"""Bytes of a voxel in the talk's compact formats [Panteleev2014]."""

ROUNDING = 2e-6
"""Relative: what coding and decoding in single precision adds to the bound of a code."""

RELMSE_LIMIT, ENERGY_LIMIT = 4e-4, 2e-3
"""What a format may add to a picture: a tenth of what the voxels themselves are allowed. 8 linear
bits and fewer than six directions are for comparison, and nothing is asked of them."""

REPETITIONS = 9
"""Timed runs of the same reads, after one that compiles."""

ORDERS = ("coherent", "random")
"""Neighbouring lanes read neighbouring places along one direction, or anything along any."""


@dataclass(frozen=True, kw_only=True)
class LitRoom:
    """The Cornell box, lit, in single precision.

    Attributes
    ----------
    prepared
        Scene and camera.
    config
        How it is rendered.
    volume
        Its voxels.
    """

    prepared: PreparedScene
    config: RenderConfig
    volume: VoxelVolume


def checks() -> list[Check]:
    """Return the checks of every format that the back end has."""
    compact = StorageConfig(format="rgb10a2")
    configs = [
        StorageConfig(),
        StorageConfig(direction_count=3),
        StorageConfig(format="float16"),
        compact,
        replace(compact, direction_count=3),
        StorageConfig(format="srgb8"),
        StorageConfig(format="rgba8"),
    ]
    if dr.backend_v(mi.Float) == dr.JitBackend.CUDA:
        configs.append(StorageConfig(format="texture16"))
    return [check for config in configs for check in _checks_of(config)]


def _checks_of(config: StorageConfig) -> list[Check]:
    """Return the checks of one format."""
    name = f"storage {config.format} x{config.direction_count}"
    make = partial(
        Check,
        configuration=f"N = {RESOLUTION}, {config.format}, {config.direction_count} directions",
        scene=SCENE,
    )
    is_talks = config.format == "rgb10a2"
    found = [
        make(
            name=f"{name}: bytes a voxel",
            measure=partial(measure_bytes, config),
            limit_low=SMALLEST_COMPACT_BYTES if is_talks else None,
            limit_high=LARGEST_COMPACT_BYTES if is_talks else None,
        )
    ]
    if config.direction_count == 6:
        measure = partial(measure_share_of_bound, config)
        found.append(make(name=f"{name}: error over bound", measure=measure, limit_high=1.0))
    if config != StorageConfig():
        is_held_to = config.direction_count == 6 and config.format != "rgba8"
        found += [
            make(
                name=f"{name}: relMSE to float32",
                measure=partial(measure_relmse, config),
                limit_high=RELMSE_LIMIT if is_held_to else None,
            ),
            make(
                name=f"{name}: energy to float32",
                measure=partial(measure_energy, config),
                limit_low=1.0 - ENERGY_LIMIT if is_held_to else None,
                limit_high=1.0 + ENERGY_LIMIT if is_held_to else None,
            ),
        ]
    for order in ORDERS:
        measure = partial(measure_read_time, config, order)
        found.append(make(name=f"{name}: ns a {order} read", measure=measure))
    return found


def measure_bytes(config: StorageConfig, context: StudyContext) -> Measured:
    """Bytes of a voxel as stored, all directions together."""
    volume = _stored(config, context)
    return Measured(value=volume.byte_count / volume.layout.voxel_count)


def measure_share_of_bound(config: StorageConfig, context: StudyContext) -> Measured:
    """Largest error of an emittance or opacity over the bound that its format states."""
    before, after = _lit_room(context).volume, _stored(config, context)
    code = CODES[config.format]
    peak = max(
        float(np.array(unpack_level(before, k).emittance).max()) for k in before.layout.levels
    )
    scale = 2.0 ** math.ceil(math.log2(peak)) if config.format in SCALED_FORMATS else 1.0
    # A texture also lets a neighbour shine through by as much as its weights are off.
    texels = after.texels
    leak = texels.weight_error() if isinstance(texels, TextureTexels) else 0.0
    worst = 0.0

    def emittance_error(emittance: np.ndarray) -> np.ndarray:
        return scale * code.emittance_error(emittance / scale)

    for level in before.layout.levels:
        true, found = unpack_level(before, level), unpack_level(after, level)
        pairs = [
            (true.emittance, found.emittance, emittance_error, peak),
            (true.opacity, found.opacity, code.opacity_error, 1.0),
        ]
        for truth, value, bound_of, largest in pairs:
            a, b = np.array(truth, dtype=np.float64), np.array(value, dtype=np.float64)
            bound = bound_of(a) + ROUNDING * np.maximum(a, b) + leak * largest
            error = np.abs(a - b)
            worst = max(worst, float((error / np.where(error > 0.0, bound, 1.0)).max()))
    return Measured(value=worst)


def measure_relmse(config: StorageConfig, context: StudyContext) -> Measured:
    """Relative squared error of the indirect light against storage in single precision."""
    truth, image = _picture(StorageConfig(), context), _picture(config, context)
    epsilon = EXPOSURE_INVARIANT_SHARE * luminance(truth).mean() ** 2
    return Measured(value=float(((image - truth) ** 2 / (truth**2 + epsilon)).mean()))


def measure_energy(config: StorageConfig, context: StudyContext) -> Measured:
    """Mean indirect light over that with storage in single precision."""
    truth, image = _picture(StorageConfig(), context), _picture(config, context)
    return Measured(value=float(image.mean() / truth.mean()))


def measure_read_time(config: StorageConfig, order: str, context: StudyContext) -> Measured:
    """Device time of a read of the medium, ns, as Dr.Jit's kernel history says."""
    volume = _stored(config, context)
    level, point, direction = _places(volume, order, 1 << (18 if context.quick else 21))
    times = []
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        for _ in range(1 + REPETITIONS):
            dr.kernel_history_clear()
            medium = read_medium(volume, level, point, direction)
            dr.eval(medium)
            dr.sync_thread()
            milliseconds = sum(kernel["execution_time"] for kernel in dr.kernel_history())
            times.append(1e6 * milliseconds / dr.width(point))
    return mean_of(times[1:])


def _places(
    volume: VoxelVolume, order: str, count: int
) -> tuple[mi.UInt32, mi.Point3f, mi.Vector3f]:
    """Return levels, points and unit directions of a fixed set of reads."""
    window = volume.layout.levels[0]
    low, extent = np.array(window.window_min), window.resolution * window.voxel_size
    rng = np.random.default_rng(1)
    if order == "random":
        place = rng.random((count, 3))
        way = rng.normal(size=(count, 3))
    else:
        # Lanes along rows of a slanted plane, a quarter of a voxel apart.
        lane = np.arange(count)
        row = 4 * window.resolution
        u, v = (lane % row) / row, ((lane // row) % row) / row
        place = np.stack([u, v, 0.25 + 0.5 * v], axis=1)
        way = np.broadcast_to([0.48, -0.6, 0.64], (count, 3))
    point = (low + extent * place).T
    unit = (way / np.linalg.norm(way, axis=1, keepdims=True)).T
    places = (
        dr.zeros(mi.UInt32, count),
        mi.Point3f(np.ascontiguousarray(point, dtype=np.float32)),
        mi.Vector3f(np.ascontiguousarray(unit, dtype=np.float32)),
    )
    dr.eval(places)
    return places


def _lit_room(context: StudyContext) -> LitRoom:
    """Return the lit Cornell box, once for all checks."""

    def light() -> LitRoom:
        config = replace(
            preset("high"),
            clipmap=ClipmapConfig(resolution=RESOLUTION),
            storage=StorageConfig(),
            samples_per_pixel=1 if context.quick else 4,
        )
        scene = load_scene(SCENE, resolution=32 if context.quick else 128)
        prepared = prepare_scene(scene.scene, scene.scene.sensors()[scene.sensor_index], config)
        return LitRoom(
            prepared=prepared, config=config, volume=light_volume(prepared, config).volume
        )

    return context.once("storage: lit room", light)


def _stored(config: StorageConfig, context: StudyContext) -> VoxelVolume:
    """Return the room's voxels in a format."""

    def store() -> VoxelVolume:
        volume = _lit_room(context).volume
        levels = [unpack_level(volume, level) for level in volume.layout.levels]
        opacity = OpacityClipmap(volume.layout, [level.opacity for level in levels])
        emittance = EmittanceClipmap(
            volume.layout,
            [level.emittance for level in levels],
            [0.0] * volume.layout.clip_level_count,
        )
        return pack_volume(opacity, emittance, config)

    return context.once(f"storage: {config}", store)


def _picture(config: StorageConfig, context: StudyContext) -> np.ndarray:
    """Return the indirect light [height, width, 3] that is seen with a format."""

    def render() -> np.ndarray:
        room = _lit_room(context)
        frame = render_frame(room.prepared, _stored(config, context), room.config)
        return np.array(frame.indirect_diffuse + frame.indirect_specular, dtype=np.float64)

    return context.once(f"storage picture: {config}", render)
