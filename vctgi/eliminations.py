"""What may be left out of a frame because its scene does not need it: names, and what is proved.

The plan decides by the scene (`vctgi.plan`); `RenderConfig.keep` names what is kept all the same,
so that `vctgi study elimination` can render with and without.
"""

from __future__ import annotations

from dataclasses import dataclass

ALL = "all"
"""Keeps everything."""

EXACT = "bit for bit"
"""Bound of what changes no bit of the picture."""


@dataclass(frozen=True)
class Elimination:
    """One thing that a scene may not need.

    Attributes
    ----------
    left_out
        What is not run or not stored.
    condition
        Of which scenes.
    bound
        How far the picture moves: `EXACT`, or a proved bound.
    """

    left_out: str
    condition: str
    bound: str = EXACT


ELIMINATIONS: dict[str, Elimination] = {
    "specular": Elimination("cones and filter of lobes", "no surface has a glossy or mirror lobe"),
    "alpha": Elimination(
        "cones through surfaces, alpha tests of voxelization",
        "no surface lets light pass, or only masks that are opaque all over",
        "albedo within 2^-20 of itself where a mask is opaque all over, else bit for bit",
    ),
    "textures": Elimination("texture coordinates of triangles", "no alpha mask reads them"),
    "levels": Elimination(
        "further clip levels, voxels of levels without surfaces",
        "fewer levels hold the whole scene",
    ),
    "directions": Elimination(
        "slots of voxels, and reads across axes that hold none",
        "no surface faces the direction, or all directions hold the same",
    ),
    "lights": Elimination(
        "reflective shadow maps of emitters",
        "the emitter's radiance is zero all over, or everything lies behind it",
    ),
    "sky": Elimination(
        "lookups of the environment, and the voxels' cones that see it",
        "there is no environment, or its radiance is zero all over",
    ),
    "bounces": Elimination(
        "scatterings after one that added little flux",
        "bounces.min_bounce_share",
        "radiance of the last scattering x a / (1 - a), a the largest albedo",
    ),
    "emission": Elimination("emittance voxelization", "nothing in the scene shines"),
    "light": Elimination(
        "lights, their maps, injection, emittance", "ambient occlusion reads opacity alone"
    ),
    "motion": Elimination(
        "voxelizing and lighting what an earlier frame did already", "nothing moved or changed"
    ),
}
"""All of them, by the name that `RenderConfig.keep` takes."""


def check_names(names: tuple[str, ...]) -> None:
    """Refuse a name that means nothing.

    Raises
    ------
    ValueError
        It names all that there are.
    """
    known = [ALL, *ELIMINATIONS]
    for name in names:
        if name not in known:
            raise ValueError(
                f"RenderConfig.keep: nothing is called {name!r}; use {', '.join(known)}."
            )
