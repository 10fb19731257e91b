"""Study "leaking": its checks, and an audit of rooms where all that is gathered has leaked."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from experiments.studies import scenes
from experiments.studies.catalogue import checks_of, find_study
from experiments.studies.exact_voxels import lay_out_window, light_exactly, scene_of
from experiments.studies.leaking.audit import PointLight, audit_points
from experiments.studies.leaking.control import MOST, audit_furnace
from experiments.studies.leaking.pictures import make_picture
from experiments.studies.tracers import constant_radiance
from metrics.leaking import audit_shares, share_of_choices
from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.peer_cones import PEER_CONE_SETS, peer_cone_set
from vctgi.scene.receivers import white_receivers
from vctgi.scene.records import GBuffer
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig, trace_diffuse
from vctgi.stages.cone_tracing.march import ConeMarchConfig

pytestmark = pytest.mark.usefixtures("variant")

ROUNDING = 1e-6
BATCHES = 8

THIN = DiffuseConesConfig(
    cone_count=64,
    aperture_scale=1e-3,
    march=ConeMarchConfig(level_bias=0.0, min_step_voxels=0.5),
)
"""Rays that read the finest level only, where a surface reaches no farther than its own voxels."""


@dataclass(frozen=True)
class Rooms:
    """A dark room beside a lit one, its voxels, and receivers in the dark."""

    scene: mi.Scene
    volume: VoxelVolume
    points: GBuffer
    radiance: mi.Float

    def leaving(self, si: mi.SurfaceInteraction3f, lane: mi.UInt32, seed: int) -> mi.Color3f:
        """Radiance of the walls, which is constant on each."""
        is_front = si.is_valid() & (mi.Float(dr.dot(mi.Vector3f(si.n), si.to_world(si.wi))) > 0.0)
        seen = dr.gather(mi.Float, self.radiance, si.prim_index, is_front)
        return mi.Color3f(dr.select(is_front, seen, 0.0))

    def audit(self, cones: DiffuseConesConfig, seed: int = 0) -> PointLight:
        return audit_points(self.scene, self.volume, self.points, cones, self.leaving, seed)


def rooms(thickness_voxels: float, *, in_voxels: bool = True) -> Rooms:
    """Return rooms with a wall between them, which the voxels may lack."""
    layout = lay_out_window(scenes.divided_rooms(0.0, 1, seed=3).triangles)
    thickness = thickness_voxels * layout.finest_voxel_size
    found = scenes.divided_rooms(thickness, 4, seed=3)
    # The wall's two faces lie across x, half its thickness from the middle.
    is_wall = np.abs(found.triangles[:, :, 0]).max(axis=1) < 0.6 * thickness
    assert is_wall.sum() == 4
    kept = np.full(len(found.triangles), True) if in_voxels else ~is_wall
    volume = light_exactly(
        scene_of(found.triangles[kept]), layout, constant_radiance(found.radiance[kept])
    )
    return Rooms(
        scene_of(found.triangles),
        volume,
        white_receivers(found.points, found.normals),
        mi.Float(found.radiance.astype(np.float32)),
    )


@pytest.mark.parametrize("name", ["leaking", "banding"])
def test_every_check_has_a_name_of_its_own_and_says_with_what(name: str) -> None:
    found = checks_of(find_study(name))
    assert len({check.name for check in found}) == len(found)
    assert all(check.configuration and check.scene for check in found)


@pytest.mark.parametrize("near_field_voxels", [0.0, 3.0])
def test_the_audit_sees_the_light_that_the_renderer_gathers(near_field_voxels: float) -> None:
    cones = DiffuseConesConfig(near_field_voxels=near_field_voxels)
    room = rooms(1.0)
    found = room.audit(cones)
    light = np.array(trace_diffuse(room.points, room.volume, cones, room.scene))[0]
    np.testing.assert_allclose(found.gathered, light, atol=ROUNDING)
    np.testing.assert_allclose(found.cone_light.sum(axis=0), light, atol=ROUNDING)
    assert found.truth.max() == 0.0


def test_parts_of_the_light_are_in_order() -> None:
    found = rooms(1.0).audit(DiffuseConesConfig())
    assert (found.hidden <= found.through + ROUNDING).all()
    assert (found.through <= found.blocked + ROUNDING).all()
    assert (found.blocked <= found.gathered + ROUNDING).all()


def test_light_of_thin_rays_behind_a_thick_wall_came_through_it() -> None:
    found = rooms(4.0).audit(THIN)
    assert found.gathered.sum() > 0.0
    assert found.hidden.sum() > 0.9 * found.gathered.sum()


def test_a_wall_that_the_voxels_lack_lets_light_through() -> None:
    closed = rooms(4.0).audit(THIN)
    opened = rooms(4.0, in_voxels=False).audit(THIN)
    assert opened.through.sum() > 10.0 * closed.through.sum()
    assert opened.hidden.sum() > 0.9 * opened.gathered.sum()


def test_a_gain_is_no_leak() -> None:
    room = rooms(1.0)
    plain = room.audit(DiffuseConesConfig())
    brighter = room.audit(DiffuseConesConfig(gain=1.05))
    assert brighter.gathered.sum() == pytest.approx(1.05 * plain.gathered.sum(), rel=ROUNDING)
    shares = [each.through.sum() / each.gathered.sum() for each in (plain, brighter)]
    assert shares[1] == pytest.approx(shares[0], rel=ROUNDING)


def test_one_choice_a_cone_finds_the_blocked_share() -> None:
    room = rooms(1.0)
    batches = [room.audit(DiffuseConesConfig(), seed) for seed in range(BATCHES)]
    row = share_of_choices(
        np.stack([each.cone_light.ravel() for each in batches]),
        np.stack([each.is_blocked.ravel() for each in batches]),
    )
    whole = sum(each.gathered.sum() for each in batches)
    blocked = sum(each.blocked.sum() for each in batches) / whole
    assert row.low is not None
    assert row.high is not None
    # Twice as far as the interval reaches: one in 20 misses it
    half = row.high - row.low
    assert abs(row.value - blocked) < half


def test_a_picture_of_sealed_rooms_is_dark_on_the_right() -> None:
    picture = make_picture("sealed_rooms", 16)
    (found,) = picture.audit(1)
    shape = (16, 16)
    truth, gathered = found.truth.reshape(shape), found.gathered.reshape(shape)
    assert truth[:, 10:].max() == 0.0
    assert truth[:, :5].mean() > 0.0
    assert gathered[:, 10:].max() > 0.0


def test_nothing_leaks_in_a_closed_box_of_one_radiance() -> None:
    audit = audit_furnace(3, 3, is_turned=False)
    # Each probe sees radiance 1, so also of cones that a near-field ray has ended.
    np.testing.assert_allclose(audit.truth, 1.0, atol=ROUNDING)
    rows = audit_shares(audit)
    assert rows["leak"].value < MOST
    assert rows["missing_light"].value < MOST


def test_cones_of_the_world_are_refused() -> None:
    name = next(each for each in PEER_CONE_SETS if peer_cone_set(each).frame == "world")
    cones = DiffuseConesConfig(cone_set=name, cone_count=peer_cone_set(name).cone_count)
    with pytest.raises(ValueError, match="frame of the surface"):
        rooms(1.0).audit(cones)
