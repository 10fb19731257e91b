"""Recover a wall's albedo and a lamp's power from one picture, by cones and by path tracing.

    python -m experiments.examples.recover_room

Both ways render the same light, of at most two scatterings, with `mi.render` inside an optimiser of
Mitsuba's. The picture is path traced at the true values. How far cones end from them is their bias,
and a path-traced picture of what they found shows how much of it is seen.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

import vctgi  # noqa: F401 - registers the integrator
from experiments.scenes.loading import load_scene
from experiments.session import start_mitsuba

ALBEDO = "red.reflectance.value"
RADIANCE = "light.emitter.radiance.value"
SCATTERINGS = 2
START_ALBEDO, START_POWER = 0.4, 0.5

DARK = 0.01
"""Squared radiance below which differences count less."""


@dataclass
class Recovered:
    """What an optimiser found."""

    albedo: np.ndarray
    """Of the wall, a number a channel."""
    power: float
    """Of the lamp, over the true one."""
    seconds: float
    """Of all steps, the first of which compiles."""
    losses: list[float]
    """Mean squared relative difference from the picture, before each step."""


@dataclass
class Room:
    """A scene, its true values, and a picture of it."""

    scene: mi.Scene
    parameters: Any
    albedo: mi.Color3f
    radiance: mi.Color3f
    target: mi.TensorXf

    def set_values(self, albedo: Any, power: Any) -> None:
        """Paint the wall, and set the lamp to a multiple of its true power."""
        self.parameters[ALBEDO] = mi.Color3f(albedo)
        self.parameters[RADIANCE] = self.radiance * power
        self.parameters.update()

    def paths(self, kind: str) -> mi.Integrator:
        """Return a path tracer for the light that cones carry."""
        found: mi.Integrator = mi.load_dict(
            {"type": kind, "max_depth": SCATTERINGS + 1, "rr_depth": 100}
        )
        return found


def make_room(edge: int, paths: int) -> Room:
    """Return the Cornell box, and its picture of so many pixels and paths a pixel."""
    scene = load_scene("cornell_box", resolution=edge).scene
    parameters: Any = mi.traverse(scene)
    albedo, radiance = mi.Color3f(parameters[ALBEDO]), mi.Color3f(parameters[RADIANCE])
    room = Room(scene, parameters, albedo, radiance, mi.TensorXf())
    room.target = _picture(scene, room.paths("path"), paths)
    return room


def recover(room: Room, integrator: mi.Integrator, steps: int, samples: int) -> Recovered:
    """Start from a gray wall and a dim lamp, and step towards the picture."""
    optimiser = mi.ad.Adam(lr=0.1)  # type: ignore[attr-defined]
    optimiser["albedo"], optimiser["power"] = mi.Color3f(START_ALBEDO), mi.Float(START_POWER)
    losses, begin = [], time.perf_counter()
    render: Any = mi.render
    for step in range(steps):
        # Smaller steps at the end, where noise would move the values about
        optimiser.set_learning_rate(0.1 * 0.1 ** (step / steps))
        room.set_values(optimiser["albedo"], optimiser["power"])
        image = render(
            room.scene, room.parameters, integrator=integrator, spp=samples, seed=2 * step
        )
        # Relative, or the noise at the edges of the lamp would drown the walls
        gap = dr.square(image[..., :3] - room.target) / (dr.square(room.target) + DARK)
        loss = dr.mean(gap, axis=None)
        dr.backward(loss)
        optimiser.step()
        optimiser["albedo"] = dr.clip(optimiser["albedo"], 0.001, 0.999)
        optimiser["power"] = dr.maximum(optimiser["power"], 0.001)
        losses.append(float(loss.array[0]))
    seconds = time.perf_counter() - begin
    albedo = np.array(optimiser["albedo"], dtype=np.float64).ravel()
    return Recovered(albedo, float(optimiser["power"][0]), seconds, losses)


def seen_error(room: Room, found: Recovered, paths: int) -> float:
    """Return the mean difference of a path-traced picture of what was found, over the mean."""
    room.set_values(mi.Color3f(found.albedo.tolist()), found.power)
    picture = np.array(_picture(room.scene, room.paths("path"), paths), dtype=np.float64)
    target = np.array(room.target, dtype=np.float64)
    return float(np.abs(picture - target).mean() / target.mean())


def _picture(scene: mi.Scene, integrator: mi.Integrator, paths: int) -> mi.TensorXf:
    render: Any = mi.render
    image: mi.TensorXf = render(scene, integrator=integrator, spp=paths, seed=1000)
    dr.eval(image)
    return image


def main() -> None:
    """Recover both ways, and say how far off they are and how long they took."""
    start_mitsuba(None)
    room = make_room(edge=48, paths=1024)
    cones = mi.load_dict({"type": "vctgi", "preset": "high", "scattering_count": SCATTERINGS})
    print(f"true: albedo {np.array(room.albedo).ravel()}, power 1")  # noqa: T201 - the result
    for name, integrator in (("cones", cones), ("prb", room.paths("prb"))):
        found = recover(room, integrator, steps=60, samples=16)
        error = seen_error(room, found, paths=1024)
        print(  # noqa: T201 - the result
            f"{name}: albedo {found.albedo}, power {found.power:.3f}, in {found.seconds:.1f} s; "
            f"path traced, the picture is off by {error:.2%}"
        )


if __name__ == "__main__":
    main()
