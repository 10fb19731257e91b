"""One diffuse bounce in the Cornell box against Mitsuba's path tracer, over phases of the grid."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from vctgi.config import preset
from vctgi.pipeline import light_volume, prepare_scene, render_frame

pytestmark = pytest.mark.usefixtures("variant")

SIZE = 64
HALF_SAMPLES = 384
"""Paths a pixel of each half of the reference."""

ENERGY = (0.92, 1.08)
"""accuracy.md section 7, mean over phases, 17 cones."""

ENERGY_OF_A_PHASE = (0.90, 1.10)
LARGEST_RELMSE = 0.030
"""accuracy.md section 7: mean over phases, debiased by two independent halves."""

SPREAD = 0.02
"""Standard deviation of the energy over phases."""

PHASES = [(0.0, 0.0, 0.0), (0.31, 0.72, 0.13), (0.52, 0.47, 0.88), (0.83, 0.24, 0.61)]
"""Places of the room in the lattice of the voxels, in voxels of the finest level."""


def relmse(image: np.ndarray, first: np.ndarray, second: np.ndarray) -> float:
    """Noise-aware relative squared error of accuracy.md section 1."""
    mean = 0.5 * (first + second)
    return float(np.mean((image - first) * (image - second) / (mean**2 + 0.01 * first.mean() ** 2)))


def cornell_at(offset: np.ndarray) -> mi.Scene:
    """Return the room, moved; the lattice of the voxels stays where it is."""
    moved = mi.ScalarTransform4f().translate(offset.tolist())
    description: Any = mi.cornell_box()  # type: ignore[no-untyped-call]
    for part in description.values():
        if isinstance(part, dict) and "to_world" in part:
            part["to_world"] = moved @ part["to_world"]
    description["sensor"]["film"].update(width=SIZE, height=SIZE, rfilter={"type": "box"})
    scene: mi.Scene = mi.load_dict(description)
    return scene


@pytest.fixture(scope="module")
def cornell(variant: str) -> mi.Scene:
    return cornell_at(np.zeros(3))


@pytest.fixture(scope="module")
def reference_halves(cornell: mi.Scene) -> list[np.ndarray]:
    """Two independent pictures of the light of exactly two scatterings."""

    def traced(max_depth: int, seed: int) -> np.ndarray:
        # The same seed makes the same first bounce, which then cancels in the difference.
        path: Any = mi.load_dict({"type": "path", "max_depth": max_depth, "rr_depth": 1000})
        picture: np.ndarray = np.array(
            mi.render(cornell, integrator=path, spp=HALF_SAMPLES, seed=mi.UInt32(seed))
        )
        return picture

    return [traced(3, seed) - traced(2, seed) for seed in (1, 2)]


def test_one_bounce_matches_the_path_tracer(
    cornell: mi.Scene, reference_halves: list[np.ndarray]
) -> None:
    truth = 0.5 * (reference_halves[0] + reference_halves[1])
    config = preset("high")
    # Half the preset's resolution, to be quick; resolution hardly matters to wide cones.
    config = replace(config, clipmap=replace(config.clipmap, resolution=64))
    assert config.diffuse.cone_count == 17
    sensor = cornell.sensors()[0]
    layout = prepare_scene(cornell, sensor, config).plan.layout
    energies, errors = [], []
    for phase in PHASES:
        offset = np.array(phase) * layout.finest_voxel_size
        scene = cornell_at(offset)
        x, y, z = (np.array(layout.centre) + offset).tolist()
        clipmap = replace(
            config.clipmap, finest_voxel_size=layout.finest_voxel_size, centre=(x, y, z)
        )
        moved = replace(config, clipmap=clipmap)
        prepared = prepare_scene(scene, scene.sensors()[0], moved)
        frame = render_frame(prepared, light_volume(prepared, moved).volume, moved)
        picture = np.array(frame.indirect_diffuse)
        energies.append(float(picture.mean() / truth.mean()))
        errors.append(relmse(picture, *reference_halves))
    assert ENERGY[0] <= np.mean(energies) <= ENERGY[1]
    assert min(energies) >= ENERGY_OF_A_PHASE[0]
    assert max(energies) <= ENERGY_OF_A_PHASE[1]
    assert np.std(energies) <= SPREAD
    assert np.mean(errors) <= LARGEST_RELMSE
