"""Light from outside that is as it was: its texels of earlier frames.

What such light meets in a window depends on the light, on the surfaces of the scene, and on that
window and its voxels. Where all of these are the same, so are its texels, bit for bit. Those who
move windows or change voxels say for which levels.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import mitsuba as mi

from vctgi.clipmap.storage import OpacityClipmap
from vctgi.scene.lights import Light
from vctgi.scene.records import LightTexels
from vctgi.scene.state import Parameters, WatchedParameters, are_same, watched_surfaces
from vctgi.stages.reflective_shadow_map.maps import MapSizes


@dataclass
class WatchedLight:
    """A light, and its parameters, to be read anew."""

    part: mi.Emitter
    parameters: WatchedParameters

    @classmethod
    def of(cls, emitter: mi.Emitter) -> WatchedLight:
        """List the parameters of a light."""
        return cls(emitter, WatchedParameters({"light": emitter}))


@dataclass
class KeptLight:
    """Texels of light from outside, for each light and clip level.

    Attributes
    ----------
    opacity
        The voxels, as they were handed over last.
    scene, surfaces
        The scene, and the parameters of its surfaces when the texels were found.
    watched
        Those parameters, and those of each light by its place, to be read anew.
    sizes
        What sized the maps.
    lights
        Parameters of each light, by its place among all lights, when they were looked at last.
    texels
        By light and level.
    """

    opacity: OpacityClipmap | None = None
    scene: mi.Scene | None = None
    surfaces: Parameters | None = None
    watched: tuple[WatchedParameters, dict[int, WatchedLight]] | None = None
    sizes: MapSizes | None = None
    lights: dict[int, Parameters] = field(default_factory=dict)
    texels: dict[tuple[int, int], LightTexels] = field(default_factory=dict)

    def follow(
        self, earlier: OpacityClipmap, opacity: OpacityClipmap, levels: Iterable[int]
    ) -> None:
        """Go on with voxels that are the earlier ones but for some levels, which are forgotten."""
        gone = set(levels)
        if self.opacity is not earlier:
            self.texels = {}
        self.opacity = opacity
        self.texels = {key: held for key, held in self.texels.items() if key[1] not in gone}

    def compare(
        self,
        scene: mi.Scene,
        lights: list[Light],
        opacity: OpacityClipmap,
        sizes: MapSizes,
    ) -> set[int]:
        """Forget what is no longer so; return the lights that are as they were.

        Parameters
        ----------
        scene, lights, opacity
            As they are now.
        sizes
            Which lights come from outside, and what sizes their maps.
        """
        if self.scene is not scene or self.watched is None:
            # Listed once, because that takes longer than all the rest.
            self.watched = watched_surfaces(scene), {}
        watched, sources = self.watched
        for index in sizes.distant:
            emitter = lights[index].emitter
            if index not in sources or sources[index].part != emitter:
                sources[index] = WatchedLight.of(emitter)
        surfaces = watched.read()
        is_same = self.scene is scene and self.sizes == sizes and self.opacity is opacity
        if self.surfaces is None or not is_same or not _are_same(self.surfaces, surfaces):
            self.lights, self.texels = {}, {}
        self.scene, self.surfaces, self.sizes, self.opacity = scene, surfaces, sizes, opacity
        now = {index: sources[index].parameters.read() for index in sizes.distant}
        same = {
            index
            for index, held in now.items()
            if index in self.lights and _are_same(self.lights[index], held)
        }
        self.lights = now
        self.texels = {key: held for key, held in self.texels.items() if key[0] in same}
        return same


def _are_same(first: Parameters, second: Parameters) -> bool:
    """Whether nothing was written to, without waiting for the device."""
    return are_same(first, second, reads_small=False)
