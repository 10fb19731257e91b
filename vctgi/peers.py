"""Recipes of other systems as configurations of our own march, over our own voxels.

Each states cone set, weights, start, step and opacity rule as published; what could not be taken
over is said beside it. So two recipes differ in their recipe alone. A system's scale that nothing
explains is a separate number, applied only where a name ends in ":published".
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from vctgi.maths.peer_cones import peer_cone_set
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig
from vctgi.stages.cone_tracing.march import ConeMarchConfig
from vctgi.stages.downsampling import DownsamplingConfig

PEER_PREFIX = "peer:"
"""What the names of these presets begin with."""

PUBLISHED_SUFFIX = ":published"
"""What they end with where the system's own scale is applied."""


@dataclass(frozen=True, kw_only=True)
class Peer:
    """The recipe of another system."""

    title: str
    """The system, and what of it is not taken over."""
    diffuse: DiffuseConesConfig
    """Cones and march, without a scale."""
    downsampling: DownsamplingConfig = field(default_factory=DownsamplingConfig)
    """Its mips."""
    scale: float = 1.0
    """Factor on the gathered light that it applies on top of its cone set's own gain."""

    @property
    def published_gain(self) -> float:
        """What a constant environment of radiance 1 gives there, in units of pi."""
        return self.scale * self.diffuse.cones().published_gain


def peer_names() -> list[str]:
    """Return the names of all these presets."""
    return [PEER_PREFIX + name + end for name in PEERS for end in ("", PUBLISHED_SUFFIX)]


def find_peer(name: str) -> tuple[Peer, DiffuseConesConfig]:
    """Return the recipe that a preset names, and its cones with the scale that it asks for.

    Raises
    ------
    ValueError
        No recipe of that name.
    """
    key = name.removeprefix(PEER_PREFIX).removesuffix(PUBLISHED_SUFFIX)
    if key not in PEERS:
        raise ValueError(
            f"no preset '{name}'; choose {PEER_PREFIX} and one of {', '.join(PEERS)}, "
            f"and {PUBLISHED_SUFFIX} after it for that system's own scale."
        )
    peer = PEERS[key]
    if not name.endswith(PUBLISHED_SUFFIX):
        return peer, peer.diffuse
    return peer, replace(peer.diffuse, gain=peer.published_gain)


_CLASSIC = ConeMarchConfig(
    step_ratio=1.0,
    min_step_voxels=1.0,
    start_offset_voxels=0.0,
    level_bias=0.0,
    pull_back_voxels=0.0,
    read="trilinear",
    weights="squared",
    correction="exponent",
    sample_place=0.0,
)
"""What most share: steps of a footprint, trilinear alpha read at the beginning of each."""

_HALF_STEPS = replace(
    _CLASSIC, step_ratio=0.5, min_step_voxels=0.5, start_offset_voxels=1.0, correction="none"
)
"""Steps of half a footprint, whose opacity is taken as it is."""

_ISOTROPIC = DownsamplingConfig(mips="average", is_isotropic=True)
"""One opacity a voxel, averaged over eight children."""


def _cones(
    cone_set: str, march: ConeMarchConfig, *, normal_offset: float = 0.0, is_turned: bool = False
) -> DiffuseConesConfig:
    """Return cones that nothing jitters."""
    return DiffuseConesConfig(
        cone_count=peer_cone_set(cone_set).cone_count,
        cone_set=cone_set,
        rotation="pixel" if is_turned else "fixed",
        is_jittered=False,
        normal_offset_voxels=normal_offset,
        march=march,
    )


_WICKED = replace(
    _CLASSIC,
    weights="normalised",
    correction="linear",
    color="proportional",
    # Steps are compared with half the edge of a voxel.
    correction_factor=2.0,
    sample_place=1.0,
)

PEERS: dict[str, Peer] = {
    "classic": Peer(
        title="The common recipe: trilinear alpha, squared direction, exponent, over our 17 cones",
        diffuse=DiffuseConesConfig(
            march=ConeMarchConfig(
                level_bias=-0.5, read="trilinear", weights="squared", correction="exponent"
            )
        ),
    ),
    "crassin": Peer(
        title="Crassin 2011: six-direction mips; the step is not published",
        diffuse=_cones("crassin6", replace(_CLASSIC, start_offset_voxels=1.0), normal_offset=1.0),
    ),
    "compix": Peer(
        title="compix: 16 world cones, emittance times the step; range of the clipmap, not 30 m",
        diffuse=_cones(
            "compix16",
            replace(_CLASSIC, color="proportional", sample_place=1.0),
            normal_offset=1.0,
        ),
        scale=15.0,
    ),
    "compix32": Peer(
        title="compix with 32 world cones",
        diffuse=_cones(
            "compix32",
            replace(_CLASSIC, color="proportional", sample_place=1.0),
            normal_offset=1.0,
        ),
        scale=15.0,
    ),
    "wicked": Peer(
        title="Wicked since #1675: opacity and emittance linear in the step, all halved",
        diffuse=_cones("wicked16", _WICKED, normal_offset=1.0),
        scale=0.5,
    ),
    "wicked_before": Peer(
        title="Wicked before #1675: slots weighted by |d|, nothing halved",
        diffuse=_cones("wicked16", replace(_WICKED, weights="projected"), normal_offset=1.0),
    ),
    "godot_hq": Peer(
        title="Godot VoxelGI, high: no correction; mips that keep some colour are not taken over",
        diffuse=_cones(
            "crassin6",
            replace(_HALF_STEPS, start_offset_voxels=1.5, min_transmittance=0.05),
        ),
        downsampling=_ISOTROPIC,
        scale=math.pi,
    ),
    "godot_lq": Peer(
        title="Godot VoxelGI, low: four cones, a level a step; colour as above",
        diffuse=_cones(
            "four",
            replace(_HALF_STEPS, step_ratio=1.0, start_offset_voxels=1.5, min_transmittance=0.05),
        ),
        downsampling=_ISOTROPIC,
        scale=math.pi,
    ),
    "ogre": Peer(
        title="Ogre-Next, six-direction mips",
        diffuse=_cones("crassin6", replace(_HALF_STEPS, min_transmittance=0.05)),
        scale=1.0 / 0.95,
    ),
    "ogre_iso": Peer(
        title="Ogre-Next, isotropic mips",
        diffuse=_cones("crassin6", replace(_HALF_STEPS, min_transmittance=0.05)),
        downsampling=_ISOTROPIC,
        scale=1.0 / 0.95,
    ),
    "threejs": Peer(
        title="three.js: three cones turned pixel by pixel, half steps with exponent",
        diffuse=_cones(
            "threejs3",
            replace(
                _CLASSIC,
                step_ratio=0.5,
                min_step_voxels=0.5,
                start_offset_voxels=1.0,
                min_transmittance=0.02,
            ),
            normal_offset=1.5,
            is_turned=True,
        ),
    ),
    "vctrenderer": Peer(
        title="VCTRenderer: six mips on an isotropic base, exponent",
        diffuse=_cones(
            "vctrenderer6",
            replace(_CLASSIC, step_ratio=0.5, min_step_voxels=0.5, start_offset_voxels=1.0),
            normal_offset=1.0,
        ),
        downsampling=DownsamplingConfig(is_isotropic=True),
    ),
    "stray_photons": Peer(
        title="Stray Photons: its six axes as cones; the propagated layers are not taken over",
        diffuse=_cones("strayphotons6", replace(_CLASSIC, correction="none"), normal_offset=1.0),
        downsampling=_ISOTROPIC,
        scale=0.95,
    ),
    "hanetaka8": Peer(
        title="Hanetaka, 8 cosine cones that end at 32 voxels' width; no inverse-square factor",
        diffuse=_cones(
            "hanetaka8",
            replace(
                _CLASSIC,
                step_rule="spheres",
                start_offset_voxels=3.5,
                max_footprint_voxels=32.0,
            ),
        ),
    ),
    "cigg": Peer(
        title="Cigg: six cones, half steps without correction, isotropic mips",
        diffuse=_cones("crassin6", _HALF_STEPS, normal_offset=1.0),
        downsampling=_ISOTROPIC,
        scale=4.0,
    ),
}
"""Recipes by name."""
