"""Built-in scene: the Cornell box."""

from __future__ import annotations

import mitsuba as mi

from experiments.scenes.parts import SceneDict, empty_scene, perspective

_FOV_DEG = 39.3077
_EYE_DISTANCE = 3.9


def cornell_box() -> SceneDict:
    """Show strong colour bleeding between diffuse walls, from one area light.

    The smallest whole test, and the one that other renderers are compared on: an error in the
    energy of the diffuse bounce shows at once. Surfaces reflect on their front side only.

    References
    ----------
    Geometry, albedos and light are those of `mi.cornell_box()`.
    """
    scene = empty_scene()
    scene.update(
        (name, value)
        for name, value in mi.cornell_box().items()  # type: ignore[no-untyped-call]
        if name not in ("type", "integrator", "sensor")
    )
    scene["sensor"] = perspective(
        (0.0, 0.0, _EYE_DISTANCE), (0.0, 0.0, 0.0), _FOV_DEG, near_clip=0.001, far_clip=100.0
    )
    return scene
