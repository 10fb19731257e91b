"""Fit the apertures of diffuse cones to path tracing, with derivatives through the march.

    python -m experiments.examples.fit_apertures

Each step draws other random phases: a picture whose cones all sample alike has ripples in its
parameters that an optimiser would stop at. `vctgi optimize` does this for many parameters, scenes
and views, and holds some of them out; here are its few lines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.scenes.loading import load_scene
from experiments.session import start_mitsuba
from vctgi.clipmap.storage import VoxelVolume
from vctgi.config import RenderConfig
from vctgi.parameters import ConeParameters
from vctgi.pipeline import light_volume, prepare_scene, render_frame
from vctgi.prepared import PreparedScene
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig

WIDEST = 3.0
"""Radians; a cone is narrower than pi."""


@dataclass
class Box:
    """The Cornell box, lit for cones.

    Attributes
    ----------
    prepared, volume, config
        The scene, its voxels, and how its cones are traced.
    """

    prepared: PreparedScene
    volume: VoxelVolume
    config: RenderConfig

    def picture(self, apertures: mi.Float, seed: int) -> mi.Float:
        """Return the numbers of a picture of indirect diffuse light."""
        cones = ConeParameters.from_config(self.config)
        cones["apertures"] = apertures
        frame = render_frame(self.prepared, self.volume, self.config, seed=seed, parameters=cones)
        return mi.Float(frame.indirect_diffuse.array)


def make_box(edge: int, voxels: int, cone_count: int) -> Box:
    """Return the box with so many pixels, voxels and cones."""
    base = RenderConfig()
    config = RenderConfig(
        clipmap=type(base.clipmap)(resolution=voxels),
        diffuse=DiffuseConesConfig(cone_count=cone_count),
        samples_per_pixel=1,
    )
    scene = load_scene("cornell_box", resolution=edge).scene
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    return Box(prepared, light_volume(prepared, config).volume, config)


def traced(box: Box, paths: int) -> mi.Float:
    """Return the same picture by path tracing: light of two scatterings, less light of one."""
    render: Any = mi.render
    images = []
    for depth in (3, 2):
        integrator = mi.load_dict({"type": "path", "max_depth": depth, "rr_depth": 100})
        images.append(render(box.prepared.scene, integrator=integrator, spp=paths, seed=0).array)
    return mi.Float(images[0] - images[1])


def fit(
    picture: Callable[[mi.Float, int], mi.Float], target: mi.Float, start: mi.Float, steps: int
) -> tuple[np.ndarray, list[float]]:
    """Return the apertures after so many steps of Adam, and the losses before each."""
    optimiser = mi.ad.Adam(lr=0.08)  # type: ignore[attr-defined]
    optimiser["apertures"] = mi.Float(start)
    losses = []
    for step in range(steps):
        loss = dr.mean(dr.square(picture(optimiser["apertures"], step) - target))
        dr.backward(loss)
        optimiser.step()
        optimiser["apertures"] = dr.clip(optimiser["apertures"], 0.05, WIDEST)
        losses.append(float(loss[0]))
    return np.array(optimiser["apertures"], dtype=np.float64), losses


def main() -> None:
    """Fit to path tracing from cones that are twice too narrow."""
    start_mitsuba(None)
    box = make_box(edge=64, voxels=64, cone_count=16)
    target = traced(box, paths=1024)
    hand_made = ConeParameters.from_config(box.config)["apertures"]
    found, losses = fit(box.picture, target, mi.Float(0.5 * hand_made), steps=60)
    by_hand = float(dr.mean(dr.square(box.picture(hand_made, 1000) - target))[0])
    print(f"apertures made by hand {np.array(hand_made)}")  # noqa: T201 - the result
    print(f"apertures fitted       {found}")  # noqa: T201 - the result
    print(  # noqa: T201 - the result
        f"squared error: at the start {losses[0]:.3g}, fitted {losses[-1]:.3g}, "
        f"by hand {by_hand:.3g}"
    )


if __name__ == "__main__":
    main()
