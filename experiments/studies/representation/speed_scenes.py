"""What the speed of voxelization is measured on: a scene that is asked for, or wavy sheets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import vctgi
from experiments.scenes import load_scene
from experiments.session import DEFAULT_RESOLUTION
from experiments.studies.check import StudyContext
from vctgi.clipmap.levels import ClipmapConfig, ClipmapLayout, lay_out_clipmap
from vctgi.config import RenderConfig
from vctgi.scene.camera import viewer
from vctgi.scene.surfaces import VoxelSurfaces, opaque_surfaces

RESOLUTION, LEVEL_COUNT = 128, 5
CONFIGURATION = f"{LEVEL_COUNT} levels of {RESOLUTION}^3, six directions"

SHEET_COUNT = 8
"""Sheets on top of each other."""

EXTENT = 8.0
"""Edge of the sheets, world units."""

BALL_RADIUS = 0.2
"""World units."""

MOVED_SHARE = 0.01
"""Of the triangles, that the object has which moves."""

NEAR_SHARE = 0.25
"""Share of the sheets' extent that the finest window holds."""


@dataclass(frozen=True)
class SpeedScene:
    """What is measured.

    Attributes
    ----------
    surfaces
        Triangles.
    layout
        Where the windows stand at first.
    direction
        Unit direction in which camera and object move.
    moving
        Numbers of the triangles of the object that moves.
    """

    surfaces: VoxelSurfaces
    layout: ClipmapLayout
    direction: np.ndarray
    moving: np.ndarray


def speed_scene(context: StudyContext) -> SpeedScene:
    """Return the scene that the study was asked for, or 262,144 triangles of wavy sheets."""
    if context.scene is None:
        return sheets(512 * 512)
    loaded = load_scene(context.scene, resolution=None, default_resolution=DEFAULT_RESOLUTION)
    sensor = loaded.scene.sensors()[loaded.sensor_index]
    clipmap = ClipmapConfig(resolution=RESOLUTION, level_count=LEVEL_COUNT)
    prepared = vctgi.prepare_scene(loaded.scene, sensor, RenderConfig(clipmap=clipmap))
    _, forward = viewer(sensor)
    layout = prepared.plan.layout
    middle = prepared.surfaces.vertices.mean(axis=1)
    distance = np.linalg.norm(middle - np.array(layout.centre), axis=1)
    nearest = np.argsort(distance)[: int(MOVED_SHARE * len(middle))]
    return SpeedScene(prepared.surfaces, layout, forward, nearest)


def sheets(triangle_count: int, resolution: int = RESOLUTION) -> SpeedScene:
    """Return wavy sheets of about so many triangles around a ball that has a hundredth of them."""
    edge = max(1, round((triangle_count / (2 * SHEET_COUNT)) ** 0.5))
    step = np.linspace(-0.5 * EXTENT, 0.5 * EXTENT, edge + 1)
    x, y = (each.ravel() for each in np.meshgrid(step, step))
    faces = _grid_faces(edge)
    parts = []
    for number in range(SHEET_COUNT):
        level = EXTENT * ((number + 0.5) / SHEET_COUNT - 0.5)
        wave = 0.3 * np.sin(3.0 * x + number) * np.cos(2.0 * y - number)
        parts.append(np.stack([x, y, level + wave], axis=1)[faces])
    voxel_size = NEAR_SHARE * EXTENT / resolution
    layout = lay_out_clipmap(
        (0.0, 0.0, 0.0),
        finest_voxel_size=voxel_size,
        level_count=LEVEL_COUNT,
        resolution=resolution,
    )
    direction = np.array([2.0, 1.0, 0.5])
    ball = _ball(max(4, round((MOVED_SHARE * triangle_count / 4) ** 0.5)))
    moving = np.arange(len(ball))
    return SpeedScene(
        opaque_surfaces(np.concatenate([ball, *parts])),
        layout,
        direction / np.linalg.norm(direction),
        moving,
    )


def _ball(edge: int) -> np.ndarray:
    """Triangles [triangle, corner, 3] of a ball of `edge` rings and twice as many segments."""
    turn, tilt = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, 2 * edge + 1), np.linspace(0.01, np.pi - 0.01, edge + 1)
    )
    points = np.stack(
        [np.cos(turn) * np.sin(tilt), np.sin(turn) * np.sin(tilt), np.cos(tilt)], axis=-1
    )
    corners = BALL_RADIUS * points
    lower = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, :-1]], axis=2)
    upper = np.stack([corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]], axis=2)
    return np.concatenate([lower.reshape(-1, 3, 3), upper.reshape(-1, 3, 3)])


def _grid_faces(edge: int) -> np.ndarray:
    """Faces [triangle, 3] of a square grid of `edge` cells along an edge."""
    corner = (np.arange(edge)[:, None] * (edge + 1) + np.arange(edge)).ravel()
    right, up = corner + 1, corner + edge + 1
    lower = np.stack([corner, right, up], axis=1)
    upper = np.stack([right, up + 1, up], axis=1)
    return np.concatenate([lower, upper])
