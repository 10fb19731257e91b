"""Texels chosen at random in place of interpolated ones: the same in the mean, in fewer reads.

A linear interpolation is the mean of reading one texel, chosen with the probability of its weight
[Hofmann2021, Fajardo2023]. A cone keeps its choice all along: its place within the voxels is moved
by one random offset, and the level that it reads by one random share, so that it meets a wall
wherever the wall stands, as a ray somewhere within the cone would. What is chosen for the cones of
a point is shared out among them, evenly by Kronecker sequences [Roberts2018].

References
----------
[Hofmann2021] N. Hofmann, J. Hasselgren, P. Clarberg, J. Munkberg, Interactive path tracing and
reconstruction of sparse volumes. [Fajardo2023] M. Fajardo, B. Wronski, M. Salvi, M. Pharr,
Stochastic texture filtering. [Roberts2018] as in `vctgi.maths.directions`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import drjit as dr
import mitsuba as mi

from vctgi.maths.directions import random_unit
from vctgi.maths.stub_gaps import as_component

Filtering = Literal["linear", "random_level", "random_texel"]
"""What a sample reads: "linear" all texels around it in two levels; "random_level" those of one of
the two; "random_texel" the one texel of each axis that a cone's random offset chooses, of one."""

LEVEL_STREAM, OFFSET_STREAM = 800, 801
"""Hash streams of the share that chooses levels and, from the second on, of the offsets."""

LEVEL_TURN = math.sqrt(2.0) - 1.0
"""Step from one cone of a point to the next in what chooses its level: not the golden ratio, which
shares out places in rings."""

OFFSET_ROOT = 1.22074408460575947536
"""Root of x^4 = x + 1, the base of the three-dimensional Kronecker sequence."""


@dataclass
class TexelChoice:
    """What chooses the texels of cones, one a lane.

    Attributes
    ----------
    level
        [0, 1): added to the fractional level, of which the whole part is read then.
    offset
        [0, 1)^3: added to the place in voxels of the level that is read, counted from centres, of
        which the whole part is read then; None: texels are interpolated.
    """

    level: mi.Float
    offset: mi.Point3f | None


def random_choice(
    sample_index: mi.UInt32, number: mi.UInt32, filtering: Filtering
) -> TexelChoice | None:
    """Return the choices of cones, one a lane.

    Parameters
    ----------
    sample_index
        Of the point that it starts at.
    number
        Of the cone among those of the point.
    filtering
        What is chosen; "linear" chooses nothing.
    """
    if filtering == "linear":
        return None

    def shared_out(stream: int, turn: float) -> mi.Float:
        place = random_unit(sample_index, stream) + mi.Float(number) * turn
        return mi.Float(place - dr.floor(place))

    level = shared_out(LEVEL_STREAM, LEVEL_TURN)
    if filtering == "random_level":
        return TexelChoice(level, None)
    offset = [
        as_component(shared_out(OFFSET_STREAM + axis, OFFSET_ROOT ** -(axis + 1)))
        for axis in range(3)
    ]
    return TexelChoice(level, mi.Point3f(offset))
