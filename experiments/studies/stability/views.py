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

BESIDE: Limits = (0.5, 2.0)
"""Energy of a view close to the standard one."""


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
            [0.0, 0.0, -1.0],
            "the wall behind it is nearer than any offset",
        ),
        "camera exactly on a wall": (
            [0.0, 0.0, 1.0],
            [0.0, 0.0, -1.0],
            "rays start on the surface behind them",
        ),
        "camera that looks along a wall": (
            [-1.0 + 1e-6, 0.0, 0.9],
            [-1.0 + 1e-6, -0.1, -1.0],
            "rays meet the wall at grazing angles",
        ),
    }
    found += [
        StabilityCase(
            name=name,
            expected="sound light of the room's size",
            why=why,
            run=partial(_seen, eye=eye, target=target),
            limits={"energy": BESIDE},
        )
        for name, (eye, target, why) in eyes.items()
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
    sensors: dict[str, tuple[dict[str, Any], str]] = {
        "field of view of 0.01 degrees": ({"fov": 0.01}, "all pixels are one point"),
        "field of view of 179 degrees": ({"fov": 179.0}, "rays at the rim are nearly parallel"),
        "thin lens": (
            {"type": "thinlens", "aperture_radius": 0.1, "focus_distance": 1.0},
            "rays of one pixel start apart",
        ),
    }
    found += [
        StabilityCase(
            name=name,
            expected="sound light of the room's size",
            why=why,
            run=partial(_through, changes=changes),
            limits={"energy": (0.3, 3.0)},
        )
        for name, (changes, why) in sensors.items()
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


def _against(context: StudyContext, found: np.ndarray) -> Outcome:
    # Of another view of the same room.
    from experiments.studies.stability.rooms import standard

    numbers = {"energy": energy(found, standard(context)), "light": float(found.max())}
    return Outcome(pictures=[found], numbers=numbers)


def _seen(context: StudyContext, eye: list[float], target: list[float]) -> Outcome:
    place = mi.ScalarTransform4f().look_at(eye, target, [0, 1, 0])
    sensor = {**camera(), "to_world": place}
    return _against(context, render(room(sensor=sensor)))


def _outside(context: StudyContext) -> Outcome:
    # Its voxels hold a corner of nothing.
    return _against(context, render(room(), settings(centre=(1000.0, 0.0, 0.0))))


def _cut(context: StudyContext) -> Outcome:
    return _against(context, render(room(), settings(centre=(1.3, 0.0, 0.0))))


def _through(context: StudyContext, changes: dict[str, Any]) -> Outcome:
    return _against(context, render(room(sensor={**camera(), **changes})))


def _parallel(_context: StudyContext) -> Outcome:
    place = mi.ScalarTransform4f().look_at([0, 0, 0.9], [0, 0, -1], [0, 1, 0]).scale([0.9, 0.9, 1])
    sensor = {**camera(), "type": "orthographic", "to_world": place}
    del sensor["fov"]
    return Outcome(pictures=[render(room(sensor=sensor))])


def _of_material(_context: StudyContext, bsdf: dict[str, Any]) -> Outcome:
    found = render(room(**walls(bsdf=bsdf)))
    return Outcome(pictures=[found], numbers={"diffuse light": float(found[..., :3].max())})
