"""Planted faults: the audit must see those that leak, and none of those that do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import mitsuba as mi
import numpy as np

import vctgi
from experiments.scenes import load_scene
from experiments.scenes.sealed_rooms import sealed_rooms
from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.leaking.audit import audit_of
from experiments.studies.leaking.pictures import (
    BATCHES,
    EDGE,
    audit_in,
    batches_of,
    dark_room,
    measured,
    picture_config,
    picture_of,
    rooms_ratio,
)
from metrics.leaking import LeakAudit, audit_shares
from vctgi.clipmap.storage import VoxelVolume
from vctgi.pipeline import voxelize_scene

FACTOR = 1.05
"""Energy that a planted fault adds everywhere."""

LEAST_RISE = 2.0
"""By how much a wall that is missing in the voxels must raise the share that came through."""

WIDER = 2.0
"""How many times as wide the cones of a planted fault are."""

PLANTED = {"leak": 0.10, "missing_light": 0.08, "L1": 0.05}
"""What the planted faults must show at least; without them these are 0.07, 0.03 and 0.01."""

LARGEST_CHANGE = 1e-3
"""Of the leaked share, when all energy grows by a factor."""


def checks() -> list[Check]:
    """Return the checks of planted faults."""
    rows: list[tuple[str, str, Callable[..., Measured], float | None, float | None]] = [
        (
            "wall removed from the voxels, share through geometry over that with it",
            "the partition is missing in the voxels, not in the scene",
            _without_wall,
            LEAST_RISE,
            None,
        ),
        (
            "wall removed from the voxels, leak",
            "the partition is missing in the voxels, not in the scene",
            partial(_share_without_wall, share="leak"),
            PLANTED["leak"],
            None,
        ),
        (
            "wall removed from the voxels, L1",
            "the partition is missing in the voxels, not in the scene",
            _rooms_without_wall,
            PLANTED["L1"],
            None,
        ),
        (
            "cones twice as wide, missing_light",
            "cones that are occluded by what lies beside them",
            _missing_with_wide_cones,
            PLANTED["missing_light"],
            None,
        ),
        (
            "energy times 1.05, change of the leaked share",
            f"cones gather {FACTOR:g} times the light",
            _brighter,
            -LARGEST_CHANGE,
            LARGEST_CHANGE,
        ),
        (
            "one NaN, refused",
            "one pixel of what is gathered; 1 if the metric refuses it",
            _one_nan,
            1.0,
            None,
        ),
    ]
    return [
        Check(
            name=f"planted fault, {name}",
            configuration=words,
            scene="built-in sealed_rooms",
            measure=measure,
            limit_low=low,
            limit_high=high,
        )
        for name, words, measure, low, high in rows
    ]


def volume_without_partition(edge: int) -> VoxelVolume:
    """Return voxels of sealed_rooms without the partition, lit by the light of the whole scene."""
    config = picture_config()
    loaded = load_scene("sealed_rooms", resolution=edge)
    whole = vctgi.prepare_scene(loaded.scene, loaded.scene.sensors()[0], config)
    description = sealed_rooms()
    del description["partition"], description["cut"]
    open_scene = mi.load_dict(description)
    bare = vctgi.prepare_scene(open_scene, open_scene.sensors()[0], config)
    voxels = voxelize_scene(replace(bare, plan=whole.plan), config)
    return vctgi.light_volume(whole, config, voxels=voxels).volume


def _audit_without_wall(context: StudyContext) -> LeakAudit:
    def audit() -> LeakAudit:
        picture = picture_of(context, "sealed_rooms")
        volume = volume_without_partition(picture.edge)
        batches = picture.audit(BATCHES[context.quick], volume)
        return audit_of(batches, (picture.edge, picture.edge))

    return context.once("audit without the wall", audit)


def _without_wall(context: StudyContext) -> Measured:
    """Ratio of the shares, with the farthest ends of their intervals."""
    open_wall = _share_without_wall(context, "leak_through")
    closed = measured(audit_shares(audit_in(context, "sealed_rooms"))["leak_through"])
    assert open_wall.low is not None
    assert open_wall.high is not None
    assert closed.low is not None
    assert closed.high is not None
    low, high = open_wall.low / closed.high, open_wall.high / closed.low
    return Measured(value=open_wall.value / closed.value, low=low, high=high)


def _share_without_wall(context: StudyContext, share: str) -> Measured:
    return measured(audit_shares(_audit_without_wall(context))[share])


def _rooms_without_wall(context: StudyContext) -> Measured:
    is_dark = dark_room(audit_in(context, "sealed_rooms"))
    return rooms_ratio(_audit_without_wall(context), is_dark)


def _missing_with_wide_cones(context: StudyContext) -> Measured:
    picture = picture_of(context, "sealed_rooms")
    diffuse = replace(picture.config.diffuse, aperture_scale=WIDER)
    wide = replace(picture, config=replace(picture.config, diffuse=diffuse))
    batches = wide.audit(BATCHES[context.quick])
    audit = audit_of(batches, (picture.edge, picture.edge))
    return measured(audit_shares(audit)["missing_light"])


def _brighter(context: StudyContext) -> Measured:
    picture = picture_of(context, "sealed_rooms")
    diffuse = replace(picture.config.diffuse, gain=FACTOR)
    brighter = replace(picture, config=replace(picture.config, diffuse=diffuse))
    shape = (picture.edge, picture.edge)
    found = audit_of(brighter.audit(BATCHES[context.quick]), shape)
    plain = audit_in(context, "sealed_rooms")
    change = [audit_shares(each)["leak"].value for each in (found, plain)]
    return Measured(value=change[0] - change[1])


def _one_nan(context: StudyContext) -> Measured:
    edge = EDGE[context.quick]
    audit = audit_of(batches_of(context, "sealed_rooms"), (edge, edge))
    gathered = audit.gathered.copy()
    gathered[0, edge // 2, edge // 2] = np.nan
    try:
        LeakAudit(gathered=gathered, through=audit.through, truth=audit.truth)
    except ValueError:
        return Measured(value=1.0)
    return Measured(value=0.0)
