"""Oracle 6: light between two unit squares is their form factor, in closed form."""

from __future__ import annotations

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import SceneDict, load, oblique, rotation_matrix
from vctgi.clipmap.levels import lay_out_clipmap
from vctgi.clipmap.storage import VoxelVolume, pack_volume
from vctgi.config import PRESETS
from vctgi.scene.receivers import white_receivers
from vctgi.scene.records import ReflectiveShadowMap
from vctgi.scene.surfaces import opaque_surfaces
from vctgi.stages.cone_tracing.diffuse import trace_diffuse
from vctgi.stages.downsampling import downsample
from vctgi.stages.light_injection import inject_light
from vctgi.stages.voxelization.opacity import voxelize_opacity

pytestmark = pytest.mark.usefixtures("variant")

EDGE_POINTS = 24
"""Receiving points along an edge of a square."""

EDGE_TEXELS = 512
"""Texels of reflected light along an edge: some twenty a voxel."""

RADIANCE = 3.0

PHASES = [(0.0, 0.0, 0.0), (0.37, 0.62, 0.18), (0.71, 0.13, 0.55), (0.22, 0.88, 0.91)]
"""Places of the grid against the squares, in voxels; the gate is on the mean over them."""

TOLERANCE = 0.20
"""accuracy.md section 7: wide cones mix what should stay apart near corners."""


def parallel_form_factor(distance: float) -> float:
    """Between two parallel unit squares that face each other."""
    a = 1.0 / distance
    b = 1.0 + a * a
    term = math.log(b * b / (1.0 + 2.0 * a * a)) / 2.0
    arcs = 2.0 * a * math.sqrt(b) * math.atan(a / math.sqrt(b)) - 2.0 * a * math.atan(a)
    return 2.0 / (math.pi * a * a) * (term + arcs)


def perpendicular_form_factor() -> float:
    """Between two unit squares that share an edge at a right angle."""
    arcs = 2.0 * math.atan(1.0) - math.sqrt(2.0) * math.atan(1.0 / math.sqrt(2.0))
    return (arcs + 0.25 * math.log(0.75)) / math.pi


class Square:
    """A unit square from a corner along two edges; its front is on the side of their product."""

    def __init__(self, corner: list[float], u: list[float], v: list[float]) -> None:
        self.corner, self.u, self.v = np.array(corner), np.array(u), np.array(v)

    def turned(self, rotation: np.ndarray) -> Square:
        rows = [(rotation @ each).tolist() for each in (self.corner, self.u, self.v)]
        return Square(*rows)

    @property
    def normal(self) -> np.ndarray:
        normal: np.ndarray = np.cross(self.u, self.v)
        return normal

    @property
    def triangles(self) -> np.ndarray:
        a, b, c, d = (
            self.corner + s * self.u + t * self.v for s, t in ((0, 0), (1, 0), (1, 1), (0, 1))
        )
        return np.array([[a, b, c], [a, c, d]])

    def shape(self, shift: np.ndarray) -> SceneDict:
        """As a Mitsuba rectangle, which spans -1 to 1."""
        matrix = np.eye(4)
        matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = 0.5 * self.u, 0.5 * self.v, self.normal
        matrix[:3, 3] = self.corner + 0.5 * (self.u + self.v) + shift
        return {"type": "rectangle", "to_world": mi.ScalarTransform4f(matrix.tolist())}

    def points(self, edge: int) -> np.ndarray:
        step = (np.arange(edge) + 0.5) / edge
        s, t = (each.ravel()[:, None] for each in np.meshgrid(step, step))
        points: np.ndarray = self.corner + s * self.u + t * self.v
        return points


def lit_volume(emitter: Square, receiver: Square, phase: tuple[float, float, float]) -> VoxelVolume:
    """Voxels of both squares, of which one sends out the same radiance everywhere."""
    voxel_size = 2.6 / 64
    centre = 0.5 * (emitter.points(2).mean(axis=0) + receiver.points(2).mean(axis=0))
    # Only the shape moves against the lattice: windows are snapped to it.
    shift = np.array(phase) * voxel_size
    x, y, z = (centre + shift).tolist()
    layout = lay_out_clipmap((x, y, z), finest_voxel_size=voxel_size, level_count=1, resolution=64)
    triangles = np.concatenate([emitter.triangles, receiver.triangles]) + shift
    opacity = voxelize_opacity(opaque_surfaces(triangles), layout)
    points = emitter.points(EDGE_TEXELS) + shift
    flux = dr.full(mi.Float, RADIANCE * math.pi / EDGE_TEXELS**2, EDGE_TEXELS**2)
    texels = ReflectiveShadowMap(
        light_name="emitter",
        level=None,
        position=mi.Point3f(np.ascontiguousarray(points.T, dtype=np.float32)),
        normal=dr.zeros(mi.Vector3f, EDGE_TEXELS**2) + mi.Vector3f(*emitter.normal.tolist()),
        incident_flux=mi.Color3f(flux),
        reflected_flux=mi.Color3f(flux),
    )
    opacity, emittance = downsample(opacity, inject_light([texels], opacity))
    assert emittance is not None
    return pack_volume(opacity, emittance)


def received(
    emitter: Square, receiver: Square, preset: str, phase: tuple[float, float, float]
) -> float:
    """Mean E / pi over the receiver, for a radiance of 1."""
    volume = lit_volume(emitter, receiver, phase)
    points = receiver.points(EDGE_POINTS) + np.array(phase) * volume.layout.finest_voxel_size
    normals = np.tile(receiver.normal, (len(points), 1))
    shift = np.array(phase) * volume.layout.finest_voxel_size
    scene = load(emitter=emitter.shape(shift), receiver=receiver.shape(shift))
    gbuffer = white_receivers(points, normals)
    found = trace_diffuse(gbuffer, volume, PRESETS[preset].diffuse, scene)
    return float(np.array(found)[0].mean()) / RADIANCE


FLOOR = Square([-0.5, 0.0, -0.5], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
WALL = Square([-0.5, 0.0, -0.5], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])


def ceiling(distance: float) -> Square:
    return Square([-0.5, distance, -0.5], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])


CASES = {
    "parallel at 0.25": (FLOOR, ceiling(0.25), parallel_form_factor(0.25)),
    "parallel at 1": (FLOOR, ceiling(1.0), parallel_form_factor(1.0)),
    "perpendicular": (FLOOR, WALL, perpendicular_form_factor()),
}


def test_closed_forms_are_the_tabulated_ones() -> None:
    assert parallel_form_factor(1.0) == pytest.approx(0.19982, abs=1e-5)
    assert perpendicular_form_factor() == pytest.approx(0.20004, abs=1e-5)


@pytest.mark.parametrize("is_turned", [False, True], ids=["axis", "turned"])
@pytest.mark.parametrize("preset", ["high", "ultra"])
@pytest.mark.parametrize("case", CASES)
def test_light_between_squares_is_their_form_factor(
    case: str, preset: str, is_turned: bool
) -> None:
    emitter, receiver, exact = CASES[case]
    if is_turned:
        rotation = rotation_matrix(oblique())
        emitter, receiver = emitter.turned(rotation), receiver.turned(rotation)
    ratios = [received(emitter, receiver, preset, phase) / exact for phase in PHASES]
    assert np.mean(ratios) == pytest.approx(1.0, abs=TOLERANCE)


def test_light_does_not_go_backwards() -> None:
    emitter, receiver, _ = CASES["parallel at 1"]
    above = receiver.points(4) + np.array([0.0, 0.3, 0.0])
    normals = np.tile(receiver.normal, (len(above), 1))
    volume = lit_volume(emitter, receiver, PHASES[0])
    # Behind the receiver, facing it from the other side: one-sided surfaces are not seen there,
    # and facing away from both there is nothing at all.
    scene = load(emitter=emitter.shape(np.zeros(3)), receiver=receiver.shape(np.zeros(3)))
    gbuffer = white_receivers(above, -normals)
    away = trace_diffuse(gbuffer, volume, PRESETS["high"].diffuse, scene)
    assert not np.array(away).any()
