"""Cameras in odd places and frames of odd sizes, and scenes of one odd material."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import mitsuba as mi
import numpy as np

from experiments.studies.check import StudyContext
from experiments.studies.stability.case import EXACT, Limits, Outcome, StabilityCase, energy
from experiments.studies.stability.rooms import camera, render, room, settings, walls

FRAMES = {"1 x 1": (1, 1), "1 x 64": (1, 64), "64 x 1": (64, 1), "3 x 2": (3, 2)}
"""Width and height, pixels."""

AWAY = 0.02
BESIDE: Limits = (0.95, 1.05)
"""Energy of a view from a hundredth of the room aside, cones turned anew."""

THROUGH: Limits = (0.85, 1.15)
"""Energy of another lens or field of view, whose pixels show other points of the same surfaces."""


def cases() -> list[StabilityCase]:
    """Return the cases of views."""
    found = [
        StabilityCase(
            name=f"frame of {name} pixels, {words}",
            expected="sound light",
            why="patterns of sparse pixels and filters need neighbours that are not there",
            run=partial(_framed, size=size, sparsity=sparsity),
        )
        for name, size in FRAMES.items()
        for sparsity, words in ((1, "dense"), (9, "sparse"))
    ]
    eyes: dict[str, tuple[list[float], list[float], str]] = {
        "camera a millionth before a wall": (
            [0.0, 0.0, 1.0 - 1e-6],
            [0.0, 0.0, 1.0 - AWAY],
            "the wall behind it is nearer than any offset",
        ),
        "camera exactly on a wall": (
            [0.0, 0.0, 1.0],
            [0.0, 0.0, 1.0 - AWAY],
            "rays start on the surface behind them",
        ),
        "camera that looks along a wall": (
            [-1.0 + 1e-6, 0.0, 0.9],
            [-1.0 + 1e-4, 0.0, 0.9],
            "rays meet the wall at grazing angles",
        ),
    }
    found += [
        StabilityCase(
            name=name,
            expected="what a camera sees that stands a little off the wall",
            why=why,
            run=partial(_beside, eye=eye, other=other),
            limits={"energy": BESIDE},
        )
        for name, (eye, other, why) in eyes.items()
    ]
    dark: dict[str, tuple[list[float], list[float], str]] = {
        "camera in a wall": (
            [0.0, 0.0, 1.1],
            [0.0, 0.0, 3.0],
            "behind the wall there is nothing",
        ),
        "camera that looks at nothing": (
            [0.0, 5.0, 0.0],
            [0.1, 9.0, 0.0],
            "no ray meets a surface",
        ),
    }
    found += [
        StabilityCase(
            name=name,
            expected="a black picture",
            why=why,
            run=partial(_seen, eye=eye, target=target),
            limits={"light": EXACT},
        )
        for name, (eye, target, why) in dark.items()
    ]
    found += [
        StabilityCase(
            name="camera far outside the clipmap",
            expected="a black picture",
            why="cones that start outside the window and cannot reach it see nothing",
            run=_outside,
            limits={"light": EXACT},
        ),
        StabilityCase(
            name="camera before a window far from the scene",
            expected="sound light",
            why="the room is cut by the window's rim",
            run=_cut,
        ),
    ]
    lens = {"type": "thinlens", "focus_distance": 1.0}
    sensors: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
        "field of view of 0.01 degrees": (
            {"fov": 0.01},
            {"fov": 0.1},
            "all pixels are one point",
        ),
        "field of view of 179 degrees": (
            {"fov": 179.0},
            {"fov": 178.9},
            "nearly all rays are nearly parallel to the picture",
        ),
        "thin lens of a tenth of the room": (
            {**lens, "aperture_radius": 0.1},
            {**lens, "aperture_radius": 0.01},
            "rays of one pixel start apart, and no offset of one fits the other",
        ),
    }
    found += [
        StabilityCase(
            name=name,
            expected="nearly what the camera sees whose parameter is less extreme",
            why=why,
            run=partial(_through, changes=changes, other=other),
            limits={"energy": THROUGH},
        )
        for name, (changes, other, why) in sensors.items()
    ]
    found.append(
        StabilityCase(
            name="parallel camera",
            expected="sound light",
            why="all rays have one direction and none an origin in common",
            run=_parallel,
        )
    )
    return found + _materials()


def _materials() -> list[StabilityCase]:
    conductor = {"type": "conductor"}
    bsdfs: dict[str, tuple[dict[str, Any], str, bool]] = {
        "mirrors": (conductor, "no surface holds light in voxels, and lobes have no width", True),
        "nearly smooth metal": (
            {"type": "roughconductor", "alpha": 1e-4},
            "densities pass all bounds",
            False,
        ),
        "glass": ({"type": "dielectric"}, "every ray goes on or back, and none is diffuse", True),
        "masks of opacity 1e-6": (
            {"type": "mask", "opacity": 1e-6, "nested": {"type": "diffuse"}},
            "next to nothing is there",
            False,
        ),
    }
    return [
        StabilityCase(
            name=f"room of {name}",
            expected="sound light" + (", none of it diffuse" if is_black else ""),
            why=why,
            run=partial(_of_material, bsdf=bsdf),
            limits={"diffuse light": EXACT} if is_black else {},
        )
        for name, (bsdf, why, is_black) in bsdfs.items()
    ]


def _framed(_context: StudyContext, size: tuple[int, int], sparsity: int) -> Outcome:
    config = settings()
    config = replace(config, reconstruction=replace(config.reconstruction, sparsity=sparsity))
    found = render(room(sensor=camera(None, *size)), config)
    assert found.shape[:2] == size[::-1], "a frame has the size that was asked for"
    return Outcome(pictures=[found])


def _seen_from(eye: list[float], target: list[float]) -> np.ndarray:
    place = mi.ScalarTransform4f().look_at(eye, target, [0, 1, 0])
    return render(room(sensor={**camera(), "to_world": place}))


def _lit(found: np.ndarray) -> Outcome:
    return Outcome(pictures=[found], numbers={"light": float(found.max())})


def _beside(_context: StudyContext, eye: list[float], other: list[float]) -> Outcome:
    found, truth = (_seen_from(each, [0.1, -0.1, -1.0]) for each in (eye, other))
    return Outcome(pictures=[found, truth], numbers={"energy": energy(found, truth)})


def _seen(_context: StudyContext, eye: list[float], target: list[float]) -> Outcome:
    return _lit(_seen_from(eye, target))


def _outside(_context: StudyContext) -> Outcome:
    # Its voxels hold a corner of nothing.
    return _lit(render(room(), settings(centre=(1000.0, 0.0, 0.0))))


def _cut(_context: StudyContext) -> Outcome:
    return _lit(render(room(), settings(centre=(1.3, 0.0, 0.0))))


def _through(_context: StudyContext, changes: dict[str, Any], other: dict[str, Any]) -> Outcome:
    found, truth = (render(room(sensor={**camera(), **each})) for each in (changes, other))
    return Outcome(pictures=[found, truth], numbers={"energy": energy(found, truth)})


def _parallel(_context: StudyContext) -> Outcome:
    place = mi.ScalarTransform4f().look_at([0, 0, 0.9], [0, 0, -1], [0, 1, 0]).scale([0.9, 0.9, 1])
    sensor = {**camera(), "type": "orthographic", "to_world": place}
    del sensor["fov"]
    return Outcome(pictures=[render(room(sensor=sensor))])


def _of_material(_context: StudyContext, bsdf: dict[str, Any]) -> Outcome:
    found = render(room(**walls(bsdf=bsdf)))
    return Outcome(pictures=[found], numbers={"diffuse light": float(found[..., :3].max())})
