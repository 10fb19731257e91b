"""glTF metallic-roughness materials as Mitsuba BSDFs and emission."""

from __future__ import annotations

from typing import Any, Final

import mitsuba as mi
import numpy as np
import numpy.typing as npt

from experiments.errors import InputError
from experiments.scenes.gltf_file import GltfFile, read_image

_WRAP_MODES: Final = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
_NEAREST: Final = 9728
_EMISSIVE_STRENGTH: Final = "KHR_materials_emissive_strength"


def surface(file: GltfFile, material: dict[str, Any], dropped: set[str]) -> dict[str, Any]:
    """BSDF of a glTF material: principled, two-sided, masked where the material has an alpha mode.

    glTF's rule that back faces are culled belongs to rasterizers; here each surface reflects on
    both sides.

    Parameters
    ----------
    file
        Where textures are read from.
    material
        An entry of `materials`; an empty dict is glTF's default material.
    dropped
        Gets a line for each property that is not converted.

    References
    ----------
    glTF 2.0 specification, section 3.9 and appendix B (alpha = roughness^2, as in Mitsuba).
    """
    for name in ("normalTexture", "occlusionTexture"):
        if name in material:
            dropped.add(f"glTF {name} ignored")
    metal = material.get("pbrMetallicRoughness", {})
    factor = np.array(metal.get("baseColorFactor", [1.0] * 4), dtype=np.float32)
    colour = _texels(file, metal.get("baseColorTexture"), dropped, is_srgb=True)
    mapped = _texels(file, metal.get("metallicRoughnessTexture"), dropped, is_srgb=False)
    base = None if colour is None else colour * factor
    reference = metal.get("metallicRoughnessTexture")
    principled = {
        "type": "principled",
        "base_color": {"type": "rgb", "value": factor[:3].tolist()}
        if base is None
        else _bitmap(file, metal["baseColorTexture"], base[..., :3]),
        "roughness": _scalar(file, reference, mapped, 1, metal.get("roughnessFactor", 1.0)),
        "metallic": _scalar(file, reference, mapped, 2, metal.get("metallicFactor", 1.0)),
    }
    bsdf: dict[str, Any] = {"type": "twosided", "nested": principled}
    mode = material.get("alphaMode", "OPAQUE")
    if mode == "OPAQUE":
        return bsdf
    opacity = factor[3:] if base is None else base[..., 3:]
    if mode == "MASK":
        opacity = (opacity >= material.get("alphaCutoff", 0.5)).astype(np.float32)
    masked = (
        float(opacity[0]) if base is None else _bitmap(file, metal["baseColorTexture"], opacity)
    )
    return {"type": "mask", "opacity": masked, "nested": bsdf}


def emission(file: GltfFile, material: dict[str, Any], dropped: set[str]) -> dict[str, Any] | None:
    """Area emitter of a glTF material, or None where it does not glow.

    The emissive factor, times `KHR_materials_emissive_strength`, is taken as radiance.
    """
    strength = material.get("extensions", {}).get(_EMISSIVE_STRENGTH, {}).get("emissiveStrength", 1)
    factor = np.array(material.get("emissiveFactor", [0.0] * 3), dtype=np.float32) * strength
    if not factor.any():
        return None
    texels = _texels(file, material.get("emissiveTexture"), dropped, is_srgb=True)
    if texels is None:
        return {"type": "area", "radiance": {"type": "rgb", "value": factor.tolist()}}
    texture = _bitmap(file, material["emissiveTexture"], texels[..., :3] * factor)
    return {"type": "area", "radiance": texture}


def _scalar(
    file: GltfFile,
    reference: dict[str, Any] | None,
    texels: npt.NDArray[np.float32] | None,
    channel: int,
    factor: float,
) -> Any:
    if texels is None or reference is None:
        return factor
    return _bitmap(file, reference, texels[..., channel : channel + 1] * np.float32(factor))


def _texels(
    file: GltfFile, reference: dict[str, Any] | None, dropped: set[str], *, is_srgb: bool
) -> npt.NDArray[np.float32] | None:
    """Linear RGBA texels of a texture, [row, column, 4], or None where there is no texture."""
    if reference is None:
        return None
    if reference.get("texCoord", 0) != 0:
        dropped.add("glTF texture coordinates other than the first set ignored")
    texture = file.tree["textures"][reference["index"]]
    stream = mi.MemoryStream()
    stream.write(read_image(file, texture["source"]))
    stream.seek(0)
    try:
        bitmap = mi.Bitmap(stream)
    except RuntimeError as error:
        raise InputError(
            what=f"the texture {texture['source']} cannot be read",
            where=str(file.path),
            remedy="store textures as PNG or JPEG",
        ) from error
    if not is_srgb:
        bitmap.set_srgb_gamma(False)
    linear = bitmap.convert(mi.Bitmap.PixelFormat.RGBA, mi.Struct.Type.Float32, False)
    return np.array(linear, dtype=np.float32)


def _bitmap(
    file: GltfFile, reference: dict[str, Any], texels: npt.NDArray[np.float32]
) -> dict[str, Any]:
    """Texture of linear texels, with the wrapping and filtering of the glTF sampler."""
    texture = file.tree["textures"][reference["index"]]
    sampler = file.tree["samplers"][texture["sampler"]] if "sampler" in texture else {}
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(texels)),
        "raw": True,
        "wrap_mode": _WRAP_MODES[sampler.get("wrapS", 10497)],
        "filter_type": "nearest" if sampler.get("magFilter") == _NEAREST else "bilinear",
    }
