"""A fingerprint of what a loaded scene holds, the same in every process and for every folder."""

from __future__ import annotations

import hashlib
import re
from typing import Any, Final

import drjit as dr
import mitsuba as mi
import numpy as np

PROBE_COUNT: Final = 64
"""Points at which a bitmap is read: its filter and wrap mode are neither parameters nor text."""
PROBE_DECIMALS: Final = 3
"""Probed texels are rounded so that another compiler's last bit is not another scene."""

# A bitmap's mean is derived from texels that are hashed themselves, in an order of summation
# that is not ours to know.
_DERIVED_LINE: Final = re.compile(r"^\s*mean = .*$", re.MULTILINE)
_FOLDER_IN_QUOTES: Final = re.compile(r'"[^"\n]*[/\\]([^"/\\\n]*)"')
_SAMPLER_START: Final = re.compile(r"^(\s*)sampler = \w+\[$")


def scene_digest(scene: mi.Scene) -> str:
    """SHA-256 over everything that `mi.traverse` reaches in a scene.

    Hashed for each object: its class, its text without folders and sampler state, every parameter
    with name, type, shape and bytes, and the digests of the objects that it refers to, so that a
    material which moves from one shape to another counts; for each shape also whether its normals
    are flipped and for each bitmap what it reads inside and outside the unit square, because
    neither is a parameter. Integrators and samplers are left out: the reference brings its own.
    The order of the shapes does not count, since Mitsuba changes it from run to run where it
    merges meshes.

    Parameters
    ----------
    scene
        A loaded scene of a Dr.Jit variant.

    Returns
    -------
    str
        64 hexadecimal digits. Stable between processes; independent of where the scene's files
        lie, not of their names.

    Raises
    ------
    ValueError
        If a parameter cannot be turned into bytes.
    """
    known: dict[mi.Object, str] = {}
    visitor = _visitor(scene)
    scene.traverse(visitor)
    shapes = []
    others = []
    for _, child in visitor.children:
        if isinstance(child, mi.Shape):
            shapes.append(_object_digest(child, known))
        elif not isinstance(child, mi.Integrator):
            others.append(_object_digest(child, known))
    return hashlib.sha256("\n".join([*others, *sorted(shapes)]).encode()).hexdigest()


def scene_objects(scene: mi.Scene) -> list[mi.Object]:
    """Every object that `mi.traverse` reaches, each once, shape groups included."""
    return list(mi.traverse(scene).hierarchy)


def _object_digest(node: mi.Object, known: dict[mi.Object, str]) -> str:
    """Digest of one object and of all below it; `known` keeps those of shared objects."""
    if node in known:
        return known[node]
    visitor = _visitor(node)
    node.traverse(visitor)
    digest = hashlib.sha256(f"{node.class_name()}\n{_text_of(node)}".encode())
    for name, value in visitor.values:
        _update_with_value(digest, f"{node.class_name()}.{name}", value)
    for name, child in visitor.children:
        if not isinstance(child, mi.Sampler):
            digest.update(f"\n{name} {_object_digest(child, known)}".encode())
    if isinstance(node, mi.Shape):
        digest.update(f"\nflipped {node.has_flipped_normals()}".encode())
    elif isinstance(node, mi.Texture) and node.class_name().startswith("Bitmap"):
        _update_with_value(digest, "probes", _probe_bitmap(node))
    known[node] = digest.hexdigest()
    return known[node]


def _visitor(node: mi.Object) -> Any:
    """Make a callback that lists values and children of one object, in Mitsuba's order.

    The class is made on the call because its base exists only once a variant is set.
    """

    class Visitor(mi.TraversalCallback):
        def __init__(self) -> None:
            super().__init__()
            self.values: list[tuple[str, Any]] = []
            self.children: list[tuple[str, mi.Object]] = []

        def put(self, name: str, value: Any, flags: Any, cpptype: Any = None) -> None:
            if isinstance(value, mi.Object):
                self.put_object(name, value, flags)
            else:
                self.put_value(name, value, flags, cpptype)

        def put_value(self, name: str, value: Any, flags: Any, cpptype: Any = None) -> None:
            del flags
            read = value if cpptype is None else mi.get_property(value, cpptype, node)
            self.values.append((name, read))

        def put_object(self, name: str, value: mi.Object | None, flags: Any) -> None:
            del flags
            if value is not None:
                self.children.append((name, value))

    return Visitor()


def _text_of(node: mi.Object) -> str:
    """Describe an object in its own words, which hold options that are no parameters."""
    text = _DERIVED_LINE.sub("", _without_sampler(str(node)))
    return _FOLDER_IN_QUOTES.sub(r'"\1"', text)


def _without_sampler(text: str) -> str:
    """Drop the sampler's block: its counters change whenever something is rendered."""
    kept = []
    end = ""
    for line in text.splitlines():
        if end:
            if line.startswith(end):
                end = ""
            continue
        start = _SAMPLER_START.match(line)
        if start:
            end = start.group(1) + "]"
            continue
        kept.append(line)
    return "\n".join(kept)


def _update_with_value(digest: hashlib._Hash, name: str, value: Any) -> None:
    """Hash one parameter: name, Python type, NumPy dtype, shape and bytes."""
    array = np.ascontiguousarray(value.matrix if hasattr(value, "matrix") else value)
    if array.dtype == object:
        raise ValueError(
            f"scene_digest: parameter {name} of type {type(value).__name__} has no bytes to "
            "hash; without it a changed scene could be taken for the same one."
        )
    digest.update(f"\n{name} {type(value).__name__} {array.dtype.str} {array.shape}\n".encode())
    digest.update(array.tobytes())


def _probe_bitmap(texture: mi.Texture) -> np.ndarray:
    """Read a bitmap on a fixed irregular set of points in [-1, 2]^2: `[channel, probe]`."""
    random = np.random.Generator(np.random.PCG64(0))
    uv = 3.0 * random.random((2, PROBE_COUNT)).astype(np.float32) - 1.0
    interaction = dr.zeros(mi.SurfaceInteraction3f, PROBE_COUNT)
    interaction.uv = mi.Point2f(mi.Float(uv[0]), mi.Float(uv[1]))
    read = np.asarray(texture.eval(interaction), dtype=np.float32)
    return np.round(read, PROBE_DECIMALS)
