"""Frames: sparse ones, those of ambient occlusion, cropped ones, and those that follow others."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import vctgi
from tests.vctgi.small_scenes import area_light, camera, diffuse, load, room
from vctgi.config import RenderConfig
from vctgi.pipeline import (
    Frame,
    FrameTally,
    PreparedScene,
    light_volume,
    prepare_scene,
    render_frame,
)

pytestmark = pytest.mark.usefixtures("variant")

SIZE = 24

SPARSE_DIFFERENCE = {4: 0.05, 9: 0.07, 16: 0.09}
"""Mean difference from the mean of many dense frames, over its mean, in a picture of only 24 x 24
pixels, most of them near an edge of the room."""

ROUNDING = 1e-5


def furnished(sensor: dict[str, Any] | None = None, **more: Any) -> mi.Scene:
    lamp = {"type": "sphere", "center": [0.3, 0.5, -0.2], "radius": 0.2, "emitter": area_light(4.0)}
    eye = sensor or camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], size=SIZE, fov=80.0)
    return load(sensor=eye, lamp=lamp, **room(bsdf=diffuse(0.6)), **more)


def settings(sparsity: int = 1, spp: int = 1, **reconstruction: Any) -> RenderConfig:
    config = vctgi.preset("medium")
    return replace(
        config,
        clipmap=replace(config.clipmap, resolution=32),
        samples_per_pixel=spp,
        reconstruction=replace(config.reconstruction, sparsity=sparsity, **reconstruction),
    )


def frame_of(scene: mi.Scene, config: RenderConfig, seed: int = 0) -> tuple[PreparedScene, Frame]:
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    volume = light_volume(prepared, config).volume
    return prepared, render_frame(prepared, volume, config, seed=seed)


def diffuse_of(frame: Frame) -> np.ndarray:
    picture: np.ndarray = np.array(frame.indirect_diffuse)
    return picture


@pytest.mark.parametrize("sparsity", [4, 9, 16])
def test_frame_of_which_every_ray_is_refined_is_the_dense_one(sparsity: int) -> None:
    scene = furnished()
    _, dense = frame_of(scene, settings(1, spp=2))
    # So strict that no neighbour counts.
    strict = settings(sparsity, spp=2, max_depth_ratio=1e-9, min_support=1.0)
    _, refined = frame_of(scene, strict)
    # All but the lamp, which reflects nothing.
    assert refined.refined_share > 0.9
    np.testing.assert_array_equal(diffuse_of(refined), diffuse_of(dense))
    assert dense.refined_share == 0.0


@pytest.mark.parametrize("sparsity", [4, 9, 16])
@pytest.mark.parametrize("is_traced_once", [False, True])
def test_sparse_frame_is_close_to_the_dense_one(sparsity: int, is_traced_once: bool) -> None:
    scene = furnished()
    _, dense = frame_of(scene, settings(1, spp=32), seed=5)
    _, sparse = frame_of(scene, settings(sparsity, spp=16, is_traced_once=is_traced_once))
    truth = diffuse_of(dense)
    found = float(np.abs(diffuse_of(sparse) - truth).mean() / truth.mean())
    assert found <= (2.0 if is_traced_once else 1.0) * SPARSE_DIFFERENCE[sparsity]
    assert sparse.refined_share < 0.05
    # All else is seen by every ray in either.
    _, same = frame_of(scene, settings(1, spp=16))
    for name in ("albedo", "normal", "depth", "position", "surface_normal"):
        np.testing.assert_array_equal(
            np.array(getattr(sparse, name)), np.array(getattr(same, name))
        )


def test_plan_says_what_sparse_pixels_save() -> None:
    prepared, _ = frame_of(furnished(), settings(9, spp=2))
    (entry,) = [e for e in prepared.plan.entries if e.item == "diffuse cones of every camera ray"]
    assert not entry.kept
    assert entry.saved == "up to 88.9% of these cones"


def test_cropped_frame_is_the_part_of_the_whole_one() -> None:
    eye = camera([0.5, 0.2, 0.9], [0.0, -0.2, 0.0], size=SIZE, fov=80.0)
    window = {"crop_offset_x": 7, "crop_offset_y": 3, "crop_width": 12, "crop_height": 9}
    part = {**eye, "film": {**eye["film"], **window}}
    _, whole = frame_of(furnished(eye), settings())
    _, cropped = frame_of(furnished(part), settings())
    for name in ("depth", "position", "normal", "albedo"):
        expected = np.array(getattr(whole, name))[3:12, 7:19]
        np.testing.assert_allclose(np.array(getattr(cropped, name)), expected, atol=1e-4)


def test_accumulated_frames_are_their_mean() -> None:
    scene = furnished()
    config = settings()
    history, pictures = None, []
    for seed in range(3):
        prepared, frame = frame_of(scene, config, seed)
        pictures.append(diffuse_of(frame))
        result, history = vctgi.accumulate_frame(history, frame, prepared.sensor, config)
    expected = np.mean(pictures, axis=0)
    assert np.abs(diffuse_of(result) - expected).max() <= 1e-3 * expected.max()
    assert (pictures[0] != pictures[1]).mean() > 0.5


def test_accumulated_ambient_occlusion_is_the_mean() -> None:
    scene = furnished()
    config = replace(vctgi.preset("ambient"), samples_per_pixel=1)
    history, pictures = None, []
    for seed in range(2):
        prepared, frame = frame_of(scene, config, seed)
        pictures.append(np.array(frame.ambient))
        result, history = vctgi.accumulate_frame(history, frame, prepared.sensor, config)
    np.testing.assert_allclose(np.array(result.ambient), np.mean(pictures, axis=0), atol=1e-3)


def glossy() -> mi.Scene:
    box = {
        "type": "cube",
        "to_world": mi.ScalarTransform4f().translate([0.0, -0.7, -0.2]).scale(0.3),
        "bsdf": {"type": "roughconductor", "alpha": 0.2},
    }
    return furnished(box=box)


def counted(scene: mi.Scene, config: RenderConfig) -> tuple[Frame, FrameTally]:
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    volume = light_volume(prepared, config).volume
    tally = FrameTally()
    return render_frame(prepared, volume, config, tally=tally), tally


def test_counting_changes_no_pixel_and_no_kernel() -> None:
    scene, config = glossy(), settings(4, spp=2)
    prepared = prepare_scene(scene, scene.sensors()[0], config)
    volume = light_volume(prepared, config).volume

    def kernels() -> list[Any]:
        return sorted(entry["hash"] for entry in dr.kernel_history() if "hash" in entry)

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        plain = render_frame(prepared, volume, config)
        before = kernels()
        tallied = render_frame(prepared, volume, config, tally=FrameTally())
        with_counts = kernels()
        again = render_frame(prepared, volume, config)
        after = kernels()
    assert before == after
    assert before != with_counts
    for name in ("indirect_diffuse", "indirect_specular"):
        picture = np.array(getattr(plain, name))
        assert picture.any()
        np.testing.assert_array_equal(picture, np.array(getattr(again, name)))
        np.testing.assert_array_equal(picture, np.array(getattr(tallied, name)))


def test_sparse_pixels_save_diffuse_cones_and_no_specular_one() -> None:
    scene = glossy()
    dense, of_dense = counted(scene, settings(1, spp=4))
    sparse, of_sparse = counted(scene, settings(4, spp=4))
    strict = settings(4, spp=4, max_depth_ratio=1e-9, min_support=1.0)
    refined, of_refined = counted(scene, strict)
    reflecting = int((np.array(dense.albedo) > 0.0).any(axis=-1).sum())
    count = settings().diffuse.cone_count
    # Pixels whose rays all meet the lamp, which reflects nothing, trace no cone.
    assert 0.9 * 4 * reflecting * count < of_dense.gathering.cone_count <= 4 * reflecting * count
    assert of_sparse.specular == of_dense.specular == of_refined.specular
    assert of_dense.specular.sample_count > 0

    def refined_cones(frame: Frame) -> int:
        return round(frame.refined_share * SIZE * SIZE * 4) * count

    # Where none may be interpolated, every ray that is reflected traces, as in the dense frame.
    assert refined_cones(refined) == of_dense.gathering.cone_count
    # The rest are those that trace for their neighbours, one in four in both.
    traced = of_refined.gathering.cone_count - refined_cones(refined)
    assert traced == of_sparse.gathering.cone_count - refined_cones(sparse)
    assert traced / of_dense.gathering.cone_count == pytest.approx(0.25, abs=0.01)


def test_ambient_cones_are_counted_with_their_real_rays() -> None:
    config = replace(vctgi.preset("ambient"), samples_per_pixel=1)
    config = replace(config, reconstruction=settings(1).reconstruction)
    frame, tally = counted(furnished(), config)
    surfaces = int((np.array(frame.depth) > 0.0).sum())
    assert tally.gathering.ray_count == surfaces * config.ambient.cone_count
    assert 0 < tally.gathering.cone_count < tally.gathering.ray_count
    assert tally.gathering.sample_count > tally.gathering.cone_count
    assert tally.specular.cone_count == 0


def test_unknown_mode_is_refused() -> None:
    with pytest.raises(ValueError, match="mode must be one of"):
        RenderConfig(mode="photons")  # type: ignore[arg-type]
