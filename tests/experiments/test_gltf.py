"""glTF: transforms, triangles, materials, textures and emission arrive exactly."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from experiments.scenes import load_scene
from experiments.scenes.mesh_access import meshes
from experiments.scenes.mesh_files import DEFAULT_LIGHT_WARNING

pytestmark = pytest.mark.usefixtures("variant")

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
CORNER_ORDER = np.array([0, 1, 2, 0, 2, 3], "<u2")
SQUARE_UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "<f4")


def write(path: Path, text: str) -> str:
    path.write_text(text, encoding="utf-8")
    return str(path)


def png() -> bytes:
    """2 x 2 texels, from the top left: red, green; blue, white."""
    texels = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)
    stream: Any = mi.MemoryStream()
    mi.Bitmap(texels).write(stream, mi.Bitmap.FileFormat.PNG)
    stream.seek(0)
    return bytes(stream.raw_buffer())


def gltf(**changes: Any) -> dict[str, Any]:
    """Describe a textured unit square and, below it in the tree, a glowing mirrored one."""
    blobs = [SQUARE.tobytes(), CORNER_ORDER.tobytes(), SQUARE_UV.tobytes(), png()]
    buffer, views = b"", []
    for blob in blobs:
        views.append({"buffer": 0, "byteOffset": len(buffer), "byteLength": len(blob)})
        buffer += blob + b"\0" * (-len(blob) % 4)
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "buffers": [
            {
                "byteLength": len(buffer),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(buffer).decode(),
            }
        ],
        "bufferViews": views,
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": 4, "type": "VEC2"},
        ],
        "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "samplers": [{"magFilter": 9728}],
        "textures": [{"source": 0, "sampler": 0}],
        "materials": [
            {
                "pbrMetallicRoughness": {
                    "baseColorTexture": {"index": 0},
                    "baseColorFactor": [0.5, 0.5, 0.5, 1],
                    "metallicFactor": 0,
                }
            },
            {
                "emissiveFactor": [1, 0.5, 0.25],
                "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}},
            },
        ],
        "meshes": [
            {
                "name": "sign",
                "primitives": [
                    {"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1, "material": 0}
                ],
            },
            {
                "name": "lamp",
                "primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 1}],
            },
        ],
        "nodes": [
            {"mesh": 0, "translation": [0, 0, 1], "children": [1]},
            {"mesh": 1, "translation": [2, 0, 0], "scale": [-1, 1, 1]},
        ],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        "extensionsUsed": ["KHR_materials_emissive_strength"],
    }
    return tree | changes


def glb(tree: dict[str, Any]) -> bytes:
    """Pack the same asset as a GLB container, its buffer in the binary chunk."""
    binary = base64.b64decode(tree["buffers"][0]["uri"].partition(",")[2])
    tree = tree | {"buffers": [{"byteLength": len(binary)}]}
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text
    body += struct.pack("<II", len(binary), 0x004E4942) + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def test_gltf_transforms_materials_and_emission_arrive(tmp_path: Path) -> None:
    tree = gltf()
    tree["materials"][0]["normalTexture"] = {"index": 0}
    loaded = load_scene(write(tmp_path / "a.gltf", json.dumps(tree)))
    assert loaded.warnings == ["glTF normalTexture ignored"]
    by_name = {mesh.name.partition("_")[0]: mesh for mesh in meshes(loaded.scene)}
    assert by_name["sign"].positions == pytest.approx(SQUARE + np.array([0, 0, 1]))
    assert by_name["lamp"].positions == pytest.approx(SQUARE * [-1, 1, 1] + [2, 0, 1])
    for mesh in by_name.values():  # a mirrored square still faces +Z
        a, b, c = mesh.positions.astype(np.float64)[mesh.faces[0]]
        assert np.cross(b - a, c - a) == pytest.approx([0, 0, 1])
    (emitter,) = loaded.scene.emitters()
    radiance = np.array(mi.traverse(emitter)["radiance.value"])
    assert radiance.ravel() == pytest.approx([4, 2, 1])


@pytest.mark.parametrize(
    ("place", "colour"),
    [((0.25, 0.75), (1, 0, 0)), ((0.75, 0.75), (0, 1, 0)), ((0.25, 0.25), (0, 0, 1))],
)
def test_a_gltf_texture_is_the_right_way_up(
    tmp_path: Path, place: tuple[float, float], colour: tuple[float, float, float]
) -> None:
    scene = load_scene(write(tmp_path / "a.gltf", json.dumps(gltf()))).scene
    ray = mi.Ray3f(mi.Point3f(*place, 2.0), mi.Vector3f(0, 0, -1))
    hit: Any = scene.ray_intersect(ray)
    texture = mi.traverse(scene)
    key = next(k for k in texture.keys() if k.endswith("base_color.data"))  # type: ignore[no-untyped-call]  # noqa: SIM118
    texels = np.array(texture[key])
    row, column = int(hit.uv[1][0] * 2), int(hit.uv[0][0] * 2)
    assert texels[row, column] == pytest.approx(0.5 * np.array(colour))


def test_a_glb_file_is_the_same_scene(tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(glb(gltf()))
    one = load_scene(str(tmp_path / "a.glb")).scene
    two = load_scene(write(tmp_path / "a.gltf", json.dumps(gltf()))).scene
    for first, second in zip(meshes(one), meshes(two), strict=True):
        assert np.array_equal(first.positions, second.positions)
        assert np.array_equal(first.faces, second.faces)


def test_gltf_without_emission_gets_the_default_light(tmp_path: Path) -> None:
    tree = gltf(nodes=[{"mesh": 0, "rotation": [0, 0, 1, 0]}])
    loaded = load_scene(write(tmp_path / "a.gltf", json.dumps(tree)))
    assert DEFAULT_LIGHT_WARNING in loaded.warnings
    (mesh,) = meshes(loaded.scene)
    assert mesh.positions == pytest.approx(SQUARE * [-1, -1, 1])  # half a turn about Z


def test_sparse_and_normalized_accessors_are_read_exactly(tmp_path: Path) -> None:
    tree = gltf(nodes=[{"mesh": 0}])
    replaced = np.array([[5, 6, 0]], "<f4").tobytes() + np.array([2], "<u2").tobytes() + b"\0\0"
    scaled = np.array([[0, 0, 0], [127, 0, 0], [127, 127, 0], [0, -128, 0]], "<i1").tobytes()
    extra = replaced + scaled
    tree["buffers"].append(
        {
            "byteLength": len(extra),
            "uri": "data:application/octet-stream;base64," + base64.b64encode(extra).decode(),
        }
    )
    tree["bufferViews"] += [
        {"buffer": 1, "byteOffset": 0, "byteLength": 12},
        {"buffer": 1, "byteOffset": 12, "byteLength": 2},
        {"buffer": 1, "byteOffset": 16, "byteLength": 12},
    ]
    tree["accessors"][0]["sparse"] = {
        "count": 1,
        "indices": {"bufferView": 5, "componentType": 5123},
        "values": {"bufferView": 4},
    }
    (mesh,) = meshes(load_scene(write(tmp_path / "s.gltf", json.dumps(tree))).scene)
    expected = SQUARE.copy()
    expected[2] = (5, 6, 0)
    assert np.array_equal(mesh.positions, expected)
    tree["accessors"][0] = {
        "bufferView": 6,
        "componentType": 5120,
        "count": 4,
        "type": "VEC3",
        "normalized": True,
    }
    (mesh,) = meshes(load_scene(write(tmp_path / "n.gltf", json.dumps(tree))).scene)
    assert np.array_equal(mesh.positions, SQUARE * [1, 1, 1] * [[1], [1], [1], [-1]])


@pytest.mark.parametrize(
    ("mode", "expected"),
    [(5, [[0, 1, 2], [1, 3, 2], [2, 3, 0], [3, 1, 0]]), (6, [[1, 2, 0], [2, 3, 0], [3, 0, 0]])],
)
def test_strips_and_fans_become_triangles(
    tmp_path: Path, mode: int, expected: list[list[int]]
) -> None:
    tree = gltf(nodes=[{"mesh": 0}])
    order = np.array([0, 1, 2, 3, 0, 1], "<u2")
    tree["bufferViews"][1]["buffer"] = 1
    tree["bufferViews"][1]["byteOffset"] = 0
    tree["buffers"].append(
        {"byteLength": 12, "uri": "data:x;base64," + base64.b64encode(order.tobytes()).decode()}
    )
    primitive = tree["meshes"][0]["primitives"][0]
    primitive["mode"] = mode
    (mesh,) = meshes(load_scene(write(tmp_path / "a.gltf", json.dumps(tree))).scene)
    assert mesh.faces[: len(expected)].tolist() == expected


def test_an_alpha_cutoff_makes_holes(tmp_path: Path) -> None:
    tree = gltf()
    tree["materials"][0] |= {"alphaMode": "MASK", "alphaCutoff": 0.5}
    tree["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1, 1, 1, 0.4]
    scene = load_scene(write(tmp_path / "a.gltf", json.dumps(tree))).scene
    ray = mi.Ray3f(mi.Point3f(0.3, 0.3, 2.0), mi.Vector3f(0, 0, -1))
    hit: Any = scene.ray_intersect(ray)
    assert dr.all(hit.bsdf().eval_null_transmission(hit)[0] == 1.0)
