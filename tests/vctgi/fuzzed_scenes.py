"""Random small scenes: shapes, materials, emitters and cameras that nobody would put together.

Kernels depend on which classes of BSDFs, emitters and shapes a scene holds, and on the layout of
its voxels. A palette fixes those, so that all scenes of one palette share their kernels and time
goes into rendering; Hypothesis draws the rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import mitsuba as mi
import numpy as np
from hypothesis import strategies as st

import vctgi
from tests.vctgi.small_scenes import SceneDict, color, diffuse, grey
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.clipmap.storage import StorageConfig
from vctgi.clipmap.unpacking import unpack_level
from vctgi.config import RenderConfig
from vctgi.errors import SceneError
from vctgi.scene.sky import SkyConfig
from vctgi.stages.cone_tracing.ambient import AmbientConfig

RESOLUTION, LEVELS, EDGE = 16, 2, 8
WINDOW = 6.4
"""Edge of the finest window; scenes reach about as far as the coarser one."""


FLAT = ("rectangle", "cube", "soup", "soup", "cube")
RANGE = AmbientConfig(range_world=0.6, range_share=None)
"""Kernels hold it, and a share of the scene would be another for every scene."""

ROUND = ("rectangle", "sphere", "cylinder", "disk", "soup")


@dataclass(frozen=True)
class Palette:
    """What decides the kernels.

    Attributes
    ----------
    bsdfs
        One instance of each of these stands in every scene.
    emitters
        One of each, too.
    shapes
        Kinds of shapes, one of each.
    sensor
        Kind of camera.
    scale
        Of all lengths.
    settings
        What the configuration differs in.
    """

    bsdfs: tuple[str, ...]
    emitters: tuple[str, ...]
    shapes: tuple[str, ...] = FLAT
    sensor: str = "perspective"
    scale: float = 1.0
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def config(self) -> RenderConfig:
        """Return a small configuration with the palette's settings."""
        config = vctgi.preset("medium")
        clipmap = ClipmapConfig(
            resolution=RESOLUTION,
            finest_voxel_size=self.scale * WINDOW / RESOLUTION,
            level_count=LEVELS,
            centre=(0.0, 0.0, 0.0),
        )
        settings = dict(self.settings)
        sparsity = settings.pop("sparsity", 1)
        near_field = settings.pop("near_field_voxels", 0.0)
        return replace(
            config,
            clipmap=clipmap,
            samples_per_pixel=1,
            reconstruction=replace(config.reconstruction, sparsity=sparsity),
            diffuse=replace(config.diffuse, near_field_voxels=near_field),
            **settings,
        )


PALETTES = {
    "diffuse": Palette(("diffuse", "twosided"), ("area",), ROUND),
    "metal": Palette(("roughconductor", "diffuse"), ("point",), settings={"sparsity": 4}),
    "plastic": Palette(("plastic", "diffuse"), ("spot",), ROUND, scale=1e-3),
    "coats": Palette(("roughplastic", "conductor"), ("directional",), sensor="thinlens"),
    "glass": Palette(("dielectric", "diffuse"), ("constant",), scale=1e3),
    "masks": Palette(
        ("mask", "diffuse"), ("envmap",), settings={"storage": StorageConfig(format="rgb10a2")}
    ),
    "panes": Palette(
        ("thindielectric", "roughplastic"), ("area", "point"), settings={"near_field_voxels": 2.0}
    ),
    "frosted": Palette(
        ("roughdielectric", "null", "diffuse"),
        ("area", "directional"),
        settings={"sky_lighting": "cones"},
    ),
    "principled": Palette(
        ("principled", "blend", "mask"),
        ("spot", "constant"),
        settings={"sky_in_cones": True, "sky": SkyConfig(resolution=32, samples_per_edge=2)},
    ),
    "ambient": Palette(
        ("diffuse", "mask"), ("point",), ROUND, settings={"mode": "ambient", "ambient": RANGE}
    ),
}
"""Which of them a scene is of."""

SMALL_TO_LARGE = st.one_of(
    st.floats(0.2, 2.0), st.floats(-3.0, 0.5).map(lambda power: float(10.0**power))
)
SOME_POWER = st.floats(-6.0, 6.0).map(lambda power: float(10.0**power))
POWERS = st.one_of(*[SOME_POWER] * 7, st.just(0.0))
SHARES = st.one_of(
    *[st.floats(0.0625, 0.9375, width=32)] * 3,
    st.sampled_from([0.0, 1.0]),
    st.floats(0.0, 1.0, width=32),
)
COORDINATES = st.one_of(st.sampled_from([-1.0, 0.0, 1.0]), st.floats(-3.0, 3.0, width=32))
POINTS = st.tuples(COORDINATES, COORDINATES, COORDINATES)
ABOVE = st.tuples(COORDINATES, COORDINATES, st.floats(-0.75, 3.0, width=32))
"""Points over the ground."""
PLACES = st.one_of(ABOVE, ABOVE, POINTS)
"""Of cameras and lamps: most see something, and some stand in the ground or below it."""
GROUNDS = st.sampled_from([(3.0, 3.0, 1.0), (-3.0, 3.0, 1.0), (30.0, 30.0, 1.0)])


@dataclass(frozen=True)
class Placement:
    """A transform by numbers: scale along the axes, turn, then move."""

    factors: tuple[float, float, float]
    axis: tuple[float, float, float]
    degrees: float
    offset: tuple[float, float, float]

    def transform(self, scale: float, *, is_uniform: bool) -> Any:
        """Return it as Mitsuba's; shapes that are round cannot be stretched."""
        factors = [self.factors[0]] * 3 if is_uniform else list(self.factors)
        length = math.sqrt(sum(each * each for each in self.axis))
        axis = [each / length for each in self.axis] if length > 1e-3 else [0.0, 0.0, 1.0]
        place = [scale * each for each in self.offset]
        turn = mi.ScalarTransform4f().translate(place).rotate(axis, self.degrees)
        return turn.scale([scale * each for each in factors])


@dataclass(frozen=True)
class FuzzedScene:
    """A scene by numbers.

    Attributes
    ----------
    shapes
        Kind, place, number of the BSDF, and a seed for what a soup of triangles looks like.
    albedos, roughness
        Numbers of the BSDFs.
    powers, places
        Of the emitters.
    eye, target, fov
        The camera.
    """

    shapes: tuple[tuple[str, Placement, int, int], ...]
    albedos: tuple[float, ...]
    roughness: float
    powers: tuple[float, ...]
    places: tuple[tuple[float, float, float], ...]
    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float


def placements() -> st.SearchStrategy[Placement]:
    """Draw transforms, mirrored ones and flat ones among them."""
    signed = st.tuples(SMALL_TO_LARGE, st.sampled_from([-1.0, 1.0])).map(math.prod)
    degrees = st.one_of(st.sampled_from([0.0, 90.0, 180.0]), st.floats(0.0, 360.0))
    factors = st.one_of(st.just((1.0, 1.0, 1.0)), st.tuples(signed, signed, signed))
    return st.builds(Placement, factors, POINTS, degrees, POINTS)


def scenes(palette: Palette) -> st.SearchStrategy[FuzzedScene]:
    """Draw scenes of a palette."""
    bsdf = st.integers(0, len(palette.bsdfs) - 1)
    seed = st.integers(0, 1000)
    # The first one is a ground, so that most scenes have something to be seen and lit.
    grounds = st.builds(Placement, GROUNDS, POINTS, st.just(0.0), st.just((0.0, 0.0, -1.0)))
    one_of_each = [
        st.tuples(st.just(kind), placements() if number else grounds, bsdf, seed)
        for number, kind in enumerate(palette.shapes)
    ]
    count = len(palette.emitters)
    return st.builds(
        FuzzedScene,
        shapes=st.tuples(*one_of_each),
        albedos=st.tuples(*[SHARES] * len(palette.bsdfs)),
        roughness=st.one_of(st.sampled_from([1e-4, 1.0]), st.floats(1e-3, 1.0)),
        powers=st.tuples(*[POWERS] * count),
        places=st.tuples(*[PLACES] * count),
        eye=PLACES,
        target=st.tuples(*[st.floats(-0.5, 0.5, width=32)] * 3),
        fov=st.one_of(*[st.floats(20.0, 150.0)] * 3, st.sampled_from([0.01, 179.0])),
    )


def load(scene: FuzzedScene, palette: Palette) -> mi.Scene:
    """Return a scene as Mitsuba's."""
    bsdfs: list[mi.BSDF] = [
        mi.load_dict(bsdf_of(kind, albedo, scene.roughness))
        for kind, albedo in zip(palette.bsdfs, scene.albedos, strict=True)
    ]
    parts: SceneDict = {"type": "scene", "sensor": sensor_of(scene, palette)}
    for number, (kind, place, bsdf, seed) in enumerate(scene.shapes):
        parts[f"shape{number}"] = shape_of(kind, place, seed, palette.scale, bsdfs[bsdf])
    for number, kind in enumerate(palette.emitters):
        parts[f"emitter{number}"] = emitter_of(
            kind, scene.powers[number], scene.places[number], palette.scale
        )
    # Merged shapes would change how many there are, of which kernels know the number.
    loaded: mi.Scene = mi.load_dict(parts, optimize=False)
    return loaded


def bsdf_of(kind: str, albedo: float, roughness: float) -> SceneDict:
    """Return a BSDF."""
    tint = color(albedo, 0.5 * albedo, 1.0 - albedo)
    made: dict[str, SceneDict] = {
        "diffuse": {"type": "diffuse", "reflectance": tint},
        "twosided": {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": tint}},
        "plastic": {"type": "plastic", "diffuse_reflectance": tint},
        "roughplastic": {"type": "roughplastic", "diffuse_reflectance": tint, "alpha": roughness},
        "conductor": {"type": "conductor", "specular_reflectance": grey(albedo)},
        "roughconductor": {"type": "roughconductor", "alpha": roughness},
        "dielectric": {"type": "dielectric", "int_ior": 1.0 + roughness},
        "thindielectric": {"type": "thindielectric", "int_ior": 1.0 + roughness},
        "roughdielectric": {"type": "roughdielectric", "alpha": roughness},
        "mask": {
            "type": "mask",
            "opacity": albedo,
            "nested": {"type": "twosided", "bsdf": diffuse(0.7)},
        },
        "null": {"type": "null"},
        "principled": {
            "type": "principled",
            "base_color": tint,
            "roughness": roughness,
            "metallic": albedo,
        },
        "blend": {"type": "blendbsdf", "weight": albedo, "a": diffuse(0.8), "b": diffuse(0.2)},
    }
    return made[kind]


def shape_of(kind: str, place: Placement, seed: int, scale: float, bsdf: mi.BSDF) -> Any:
    """Return a shape."""
    to_world = place.transform(scale, is_uniform=kind in ("sphere", "cylinder", "disk"))
    if kind == "soup":
        return soup(to_world, seed, bsdf)
    return {"type": kind, "to_world": to_world, "bsdf": bsdf}


def soup(to_world: Any, seed: int, bsdf: mi.BSDF) -> mi.Mesh:
    """Return random triangles, a sliver, one that is there twice and some without an area."""
    rng = np.random.default_rng(seed)
    vertices = rng.uniform(-1.0, 1.0, (int(rng.integers(4, 12)), 3))
    faces = rng.integers(0, len(vertices), (int(rng.integers(3, 10)), 3))
    vertices[-1] = vertices[0] + 1e-6 * rng.normal(size=3)
    faces[0], faces[1] = [0, 1, 2], [0, len(vertices) - 1, 1]
    faces[-1] = faces[0]
    matrix = np.array(to_world.matrix, dtype=np.float64).reshape(4, 4)
    vertices = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    properties = mi.Properties()
    properties["bsdf"] = bsdf
    made = mi.Mesh("soup", len(vertices), len(faces), props=properties)
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = mi.Float(np.float32(vertices).ravel())
    parameters["faces"] = mi.UInt32(np.uint32(faces).ravel())
    parameters.update()
    return made


def emitter_of(
    kind: str, power: float, place: tuple[float, float, float], scale: float
) -> SceneDict:
    """Return an emitter."""
    origin = [scale * each for each in place]
    toward = mi.ScalarTransform4f().look_at(origin, [0.1 * scale, 0.2 * scale, 0.0], [0, 0, 1])
    light = grey(power)
    made: dict[str, SceneDict] = {
        # Not a rectangle: kernels hold the transform of one that shines.
        "area": {
            "type": "cube",
            "to_world": toward.scale(0.5 * scale),
            "emitter": {"type": "area", "radiance": light},
        },
        "point": {"type": "point", "position": origin, "intensity": light},
        "spot": {"type": "spot", "to_world": toward, "intensity": light},
        "directional": {
            "type": "directional",
            "direction": [*place[:2], place[2] - 5.0],
            "irradiance": light,
        },
        "constant": {"type": "constant", "radiance": light},
        "envmap": {"type": "envmap", "bitmap": _sky(power), "scale": 1.0},
    }
    return made[kind]


def _sky(power: float) -> mi.Bitmap:
    values = np.zeros((4, 8, 3), dtype=np.float32)
    values[1, 3] = power
    values[2] = 0.1 * power
    return mi.Bitmap(values)


def sensor_of(scene: FuzzedScene, palette: Palette) -> SceneDict:
    """Return the camera; one that looks at itself looks along an axis."""
    eye = np.array(scene.eye)
    target = np.array(scene.target)
    if np.linalg.norm(target - eye) < 1e-2:
        target = eye + np.array([1.0, 0.0, 0.0])
    forward = (target - eye) / np.linalg.norm(target - eye)
    up = [0.0, 1.0, 0.0] if abs(forward[1]) < 0.9 else [1.0, 0.0, 0.0]
    place = mi.ScalarTransform4f().look_at(
        (palette.scale * eye).tolist(), (palette.scale * target).tolist(), up
    )
    lens = {"aperture_radius": 0.1 * palette.scale, "focus_distance": palette.scale}
    return {
        "type": palette.sensor,
        "fov": scene.fov,
        "near_clip": 1e-3 * palette.scale,
        "far_clip": 1e3 * palette.scale,
        "to_world": place,
        "film": {
            "type": "hdrfilm",
            "width": EDGE,
            "height": EDGE,
            "rfilter": {"type": "box"},
            "component_format": "float32",
        },
        **(lens if palette.sensor == "thinlens" else {}),
    }


def render(scene: FuzzedScene, palette: Palette) -> dict[str, np.ndarray] | SceneError:
    """Return the pictures and the voxels of a scene, or why there are none.

    Anything else that is raised is a fault.
    """
    world = load(scene, palette)
    config = palette.config
    try:
        prepared = vctgi.prepare_scene(world, world.sensors()[0], config)
        volume = vctgi.light_volume(prepared, config).volume
        frame = vctgi.render_frame(prepared, volume, config)
    except SceneError as refusal:
        return refusal
    levels = [unpack_level(volume, level) for level in volume.layout.levels]
    names = ("indirect_diffuse", "indirect_specular", "albedo", "depth", "ambient")
    found = {name: getattr(frame, name) for name in (*names, "normal", "position")}
    pictures = {name: np.array(each) for name, each in found.items() if each is not None}
    for name in ("opacity", "emittance"):
        values = [np.array(getattr(each, name)).ravel() for each in levels]
        pictures[f"voxels' {name}"] = np.concatenate(values)
    return pictures
