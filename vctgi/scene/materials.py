"""What each BSDF contributes to voxels, and which lobes it has.

The voxels hold outgoing radiance that is the same in every direction of a hemisphere, so a BSDF
enters them by its albedo: the share of incident light that it reflects, all reflecting lobes
together, found by sampling the BSDF itself. That keeps the energy and loses the direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import mitsuba as mi

CONTRIBUTIONS = {
    "SmoothDiffuse": "reflects its full albedo; exact",
    "RoughPlastic": "reflects base and coat together, evenly in all directions",
    "SmoothPlastic": "reflects base and coat together, evenly in all directions",
    "RoughConductor": "reflects its albedo evenly in all directions",
    "SmoothConductor": "reflects its albedo evenly in all directions",
    "SmoothDielectric": "reflects its albedo evenly; blocks cones, as at one bounce it lets no "
    "light of a lamp through",
    "RoughDielectric": "reflects its albedo evenly; blocks cones, as at one bounce it lets no "
    "light of a lamp through",
    "ThinDielectric": "reflects its albedo evenly; lets cones through by its null transmission",
    "Principled": "reflects its albedo evenly in all directions; transmission contributes nothing",
    "PrincipledThin": "reflects its albedo evenly; transmission contributes nothing",
    "MaskBSDF": "reflects and stops light by its opacity",
    "BlendBSDF": "reflects the albedo of the blend evenly in all directions",
    "BumpMap": "reflects the nested albedo; bumps turn the normal of the picture only",
    "NormalMap": "reflects the nested albedo; the map turns the normal of the picture only",
    "Null": "lets all light through",
}
"""By Mitsuba class: what a surface of this kind does in the voxels."""

MASK = "MaskBSDF"
"""Mitsuba class of alpha masks."""

GENERIC_CONTRIBUTION = "not known by name: reflects the albedo that its sample() method gives"


@dataclass(frozen=True, kw_only=True)
class Material:
    """One BSDF.

    Attributes
    ----------
    kind
        Mitsuba class of the BSDF inside two-sided adapters.
    contribution
        What it does in the voxels, one sentence.
    is_two_sided
        Whether both sides reflect.
    has_diffuse, has_specular
        Whether it has a diffuse reflection; glossy or mirror-like reflection.
    has_null
        Whether light passes it undeflected (mask, thin dielectric).
    is_opaque_mask
        Whether it is a mask that lets nothing through, and is read as what it masks.
    is_anisotropic
        Whether it has a glossy lobe that may be wider in one direction than across.
    is_known
        Whether the contribution is stated for its class.
    """

    kind: str
    contribution: str
    is_two_sided: bool
    has_diffuse: bool
    has_specular: bool
    has_null: bool
    is_known: bool
    is_anisotropic: bool = False
    is_opaque_mask: bool = False


def describe_material(bsdf: mi.BSDF, *, is_opaque_mask: bool = False) -> Material:
    """Return which lobes a BSDF has and what it contributes.

    Parameters
    ----------
    bsdf
        Any BSDF.
    is_opaque_mask
        Whether it is known to be a mask that is opaque all over (`vctgi.scene.constants`).
    """
    flags = bsdf.flags()
    nested = inside_two_sided(bsdf)
    kind = nested.class_name()
    return Material(
        kind=kind,
        contribution=CONTRIBUTIONS.get(kind, GENERIC_CONTRIBUTION),
        is_two_sided=bsdf.class_name() == "TwoSidedBRDF" or _has(flags, "BackSide"),
        has_diffuse=_has(flags, "DiffuseReflection"),
        has_specular=_has(flags, "GlossyReflection") or _has(flags, "DeltaReflection"),
        has_null=_has(flags, "Null") and not is_opaque_mask,
        is_known=kind in CONTRIBUTIONS,
        is_anisotropic=_has(flags, "GlossyReflection") and _has(flags, "Anisotropic"),
        is_opaque_mask=is_opaque_mask,
    )


def _has(flags: int, name: str) -> bool:
    return bool(int(flags) & int(getattr(mi.BSDFFlags, name)))


def inside_two_sided(bsdf: mi.BSDF) -> mi.BSDF:
    """Return the BSDF within two-sided adapters."""
    if bsdf.class_name() != "TwoSidedBRDF":
        return bsdf
    nested = nested_bsdfs(bsdf)
    return nested[0] if nested else bsdf


def nested_bsdfs(bsdf: mi.BSDF) -> list[mi.BSDF]:
    """Return the BSDFs that one is made of."""
    nested: list[mi.BSDF] = []

    class Collector(mi.TraversalCallback):
        def put(self, _name: str, value: object, *_: object) -> None:
            if isinstance(value, mi.BSDF):
                nested.append(value)

    bsdf.traverse(Collector())
    return nested
