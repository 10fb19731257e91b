"""The same input gives the same bits, and another seed other noise of the same mean."""

from __future__ import annotations

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import area_light, camera, load, oblique, room
from vctgi.clipmap.unpacking import unpack_level
from vctgi.config import RenderConfig, preset
from vctgi.pipeline import light_volume, prepare_scene, render_frame

pytestmark = pytest.mark.usefixtures("variant")

NOISE_OF_A_SEED = 0.02
"""Relative, of the picture's mean: azimuths and phases of a few thousand cones."""


def furnished_room(size: int = 24) -> mi.Scene:
    lamp = {
        "type": "sphere",
        "center": [0.3, 0.5, -0.2],
        "radius": 0.2,
        "emitter": area_light(4.0),
    }
    box = {
        "type": "cube",
        "to_world": mi.ScalarTransform4f().translate([-0.3, -0.6, -0.2]) @ oblique().scale(0.3),
        "bsdf": {"type": "twosided", "bsdf": {"type": "roughconductor", "alpha": 0.3}},
    }
    eye = camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], size=size, fov=80.0)
    return load(sensor=eye, lamp=lamp, box=box, **room())


def small(name: str = "medium") -> RenderConfig:
    config = preset(name)
    return replace(config, clipmap=replace(config.clipmap, resolution=32), samples_per_pixel=1)


def render(scene: mi.Scene, config: RenderConfig, seed: int = 0) -> dict[str, np.ndarray]:
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    frame = render_frame(prepared, light_volume(prepared, config).volume, config, seed=seed)
    names = ("indirect_diffuse", "indirect_specular", "albedo", "normal", "depth")
    return {name: np.array(getattr(frame, name)) for name in names}


def test_same_input_gives_the_same_bits() -> None:
    first, second = (render(furnished_room(), small()) for _ in range(2))
    for name, image in first.items():
        assert image.any(), name
        np.testing.assert_array_equal(image, second[name])


def test_same_voxels_twice() -> None:
    config = small()
    tables = []
    for _ in range(2):
        scene = furnished_room()
        prepared = prepare_scene(scene, scene.sensors()[0], config)
        volume = light_volume(prepared, config).volume
        tables.append([unpack_level(volume, level) for level in volume.layout.levels])
    for one, other in zip(*tables, strict=True):
        np.testing.assert_array_equal(np.array(one.opacity), np.array(other.opacity))
        np.testing.assert_array_equal(np.array(one.emittance), np.array(other.emittance))


def test_seed_changes_the_noise_and_not_the_mean() -> None:
    scene = furnished_room()
    first, second = (render(scene, small(), seed)["indirect_diffuse"] for seed in (0, 1))
    assert (first != second).mean() > 0.5
    assert second.mean() == pytest.approx(first.mean(), rel=NOISE_OF_A_SEED)


def test_seeds_stay_apart_in_large_pictures() -> None:
    # 512 x 512 pixels times the samples of a seed are a power of two that 32 bits could lose.
    config = replace(small(), clipmap=replace(small().clipmap, resolution=8))
    scene = furnished_room(size=512)
    pictures = [render(scene, config, seed)["indirect_diffuse"] for seed in (0, 4)]
    assert (pictures[0] != pictures[1]).mean() > 0.5
