"""The digest changes with everything that a scene holds and with nothing else."""

from __future__ import annotations

import copy
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from reference import scene_digest
from tests.reference import reference_scenes as scenes

REPOSITORY = Path(__file__).parents[2]


def digest(scene: dict[str, Any]) -> str:
    return scene_digest(mi.load_dict(scene))


def change(scene: dict[str, Any], path: str, value: Any) -> dict[str, Any]:
    changed = copy.copy(scene)
    head, _, tail = path.partition("/")
    changed[head] = change(scene[head], tail, value) if tail else value
    return changed


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("block/bsdf/reflectance/value", 0.41),
        ("floor/bsdf/reflectance/filter_type", "nearest"),
        ("floor/bsdf/reflectance/wrap_mode", "clamp"),
        ("floor/flip_normals", True),
        ("block/bsdf", {"type": "twosided", "inner": {"type": "diffuse"}}),
        ("light/emitter/radiance/value", 3.1),
        ("sensor/fov", 46.0),
        ("sensor/near_clip", 0.02),
        ("sensor/film/width", 9),
        ("sensor/film/crop_width", 4),
        ("fill", {"type": "point", "position": [0, 1, 0]}),
    ],
)
def test_every_change_of_the_scene_changes_the_digest(path: str, value: Any) -> None:
    scene = scenes.textured()
    assert digest(change(scene, path, value)) != digest(scene)


def test_one_texel_or_one_vertex_changes_the_digest() -> None:
    assert digest(scenes.textured(texel=0.31)) != digest(scenes.textured())
    scene = mi.load_dict(scenes.textured())
    before = scene_digest(scene)
    parameters = mi.traverse(scene)
    name = next(key for key in parameters.properties if key.endswith("vertex_positions"))
    positions = parameters[name]
    positions[0] = positions[0] + 1e-4
    parameters[name] = positions
    parameters.update()
    assert scene_digest(scene) != before


def test_a_material_that_moves_to_another_shape_changes_the_digest() -> None:
    def scene(first: float, second: float) -> dict[str, Any]:
        return {
            "type": "scene",
            "dark": scenes.diffuse(0.2) | {"id": "dark"},
            "light": scenes.diffuse(0.8) | {"id": "light"},
            "a": scenes.sphere([0, 0, 0], 1.0, bsdf={"type": "ref", "id": "dark"}),
            "b": scenes.sphere([3, 0, 0], 1.0, bsdf={"type": "ref", "id": "light"}),
            "c": scenes.sphere([6, 0, 0], 1.0, bsdf={"type": "ref", "id": "dark"}),
            "d": scenes.sphere(
                [9, 0, 0], 1.0, bsdf={"type": "ref", "id": "dark" if first > second else "light"}
            ),
        }

    assert digest(scene(1, 0)) != digest(scene(0, 1))


def test_rendering_does_not_change_the_digest() -> None:
    scene = mi.load_dict(scenes.textured())
    before = scene_digest(scene)
    dr.eval(mi.render(scene, integrator=mi.load_dict({"type": "path"}), spp=4))
    assert scene_digest(scene) == before


def test_where_the_files_lie_does_not_change_the_digest(tmp_path: Path) -> None:
    random = np.random.Generator(np.random.PCG64(1))
    texels = random.random((4, 4, 3)).astype(np.float32)
    digests = set()
    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
        texture = tmp_path / folder / "texels.exr"
        mesh = tmp_path / folder / "block.ply"
        mi.Bitmap(texels).write(str(texture))
        mi.load_dict({"type": "cube"}).write_ply(str(mesh))
        bitmap = {"type": "bitmap", "filename": str(texture)}
        digests.add(
            digest(
                {
                    "type": "scene",
                    "a": {
                        "type": "ply",
                        "filename": str(mesh),
                        "bsdf": {"type": "diffuse", "reflectance": bitmap},
                    },
                    "sky": {"type": "envmap", "filename": str(texture)},
                }
            )
        )
    assert len(digests) == 1


@pytest.mark.parametrize("make_scene", [scenes.cornell, scenes.under_a_sky])
def test_the_digest_is_the_same_in_every_process(make_scene: Callable[[], dict[str, Any]]) -> None:
    """Mitsuba merges the Cornell box's meshes, in an order that changes from run to run."""
    code = (
        f"import mitsuba as mi; mi.set_variant({mi.variant()!r});"
        "from reference import scene_digest; from tests.reference import reference_scenes as s;"
        f"print(scene_digest(mi.load_dict(s.{make_scene.__name__}())))"
    )
    elsewhere = {
        subprocess.run(
            [sys.executable, "-c", code], cwd=REPOSITORY, check=True, capture_output=True, text=True
        ).stdout.strip()
        for _ in range(3)
    }
    assert elsewhere == {digest(make_scene())}
