"""Light from outside that is as it was: its texels of earlier frames.

What such light meets in a window depends on the light, on the surfaces of the scene, and on that
window and its voxels. Where all of these are the same, so are its texels, bit for bit. Those who
move windows or change voxels say for which levels.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import dataclass, field

import mitsuba as mi

from vctgi.scene.lights import Light
from vctgi.scene.records import LightTexels
from vctgi.scene.state import Parameters, WatchedParameters, are_same, watched_surfaces


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

    scene: mi.Scene | None = None
    surfaces: Parameters | None = None
    watched: tuple[WatchedParameters, dict[int, WatchedLight]] | None = None
    sizes: Hashable = None
    lights: dict[int, Parameters] = field(default_factory=dict)
    texels: dict[tuple[int, int], LightTexels] = field(default_factory=dict)

    def forget_levels(self, levels: Iterable[int]) -> None:
        """Forget what was found for levels whose window or voxels changed."""
        gone = set(levels)
        self.texels = {key: held for key, held in self.texels.items() if key[1] not in gone}

    def compare(
        self, scene: mi.Scene, lights: list[Light], distant: list[int], sizes: Hashable
    ) -> set[int]:
        """Forget what is no longer so; return the lights that are as they were.

        Parameters
        ----------
        scene, lights
            As they are now.
        distant
            Places of the lights from outside.
        sizes
            What sizes the maps.
        """
        if self.scene is not scene or self.watched is None:
            # Listed once, because that takes longer than all the rest.
            self.watched = watched_surfaces(scene), {}
        watched, sources = self.watched
        for index in distant:
            emitter = lights[index].emitter
            if index not in sources or sources[index].part != emitter:
                sources[index] = WatchedLight.of(emitter)
        surfaces = watched.read()
        is_same = self.scene is scene and self.sizes == sizes
        if self.surfaces is None or not is_same or not _are_same(self.surfaces, surfaces):
            self.lights, self.texels = {}, {}
        self.scene, self.surfaces, self.sizes = scene, surfaces, sizes
        now = {index: sources[index].parameters.read() for index in distant}
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
