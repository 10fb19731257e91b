"""The columns of the study: a configuration each, and what is asked of it in every row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from experiments.studies.closed_forms import MOST_FURNACE
from experiments.studies.exact_voxels import RESOLUTION
from experiments.studies.tracers import Bench
from vctgi.config import preset
from vctgi.peers import PEERS
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig

Bounds = tuple[float | None, float | None]
"""Least and largest value that passes."""

UNBOUNDED: Bounds = (None, None)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a column must keep to, and goals.

    Attributes
    ----------
    energy, phase_energy
        Of the energy ratio in the Cornell box: its mean over phases, and that of every phase.
    relmse, relmse_goal, mre, spread
        Largest of the errors there, and of the standard deviation of energy over phases.
    furnace, furnace_goal
        Least mean of the white furnace, in either placement.
    furnace_points
        Of every single point of it.
    squares, squares_goal
        Relative error of the mean over a square.
    leaks
        For each placement and thickness of the wall in voxels the most that may leak through.
    """

    energy: Bounds = UNBOUNDED
    phase_energy: Bounds = UNBOUNDED
    relmse: float | None = None
    relmse_goal: float | None = None
    mre: float | None = None
    spread: float | None = None
    furnace: float | None = None
    furnace_goal: float | None = None
    furnace_points: Bounds = UNBOUNDED
    squares: float | None = None
    squares_goal: float | None = None
    leaks: Mapping[str, Mapping[float, float]] | None = None


WALL_VOXELS = (0.25, 1.0, 2.0, 4.0)
"""Thicknesses of the wall between the rooms."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """One configuration.

    Attributes
    ----------
    name
        For the names of rows.
    cones
        What is traced.
    limits
        What is asked of it.
    """

    name: str
    cones: DiffuseConesConfig
    limits: Limits

    @property
    def words(self) -> str:
        """The configuration in words, for the table."""
        return describe_cones(self.cones)


def describe_cones(cones: DiffuseConesConfig) -> str:
    """Return what decides a row, in words."""
    march = cones.march
    near = cones.near_field_voxels
    return (
        f"{cones.cone_count} cones, {march.read} read, {march.weights} weights, "
        f"correction by {march.correction}, level bias {march.level_bias:g}, "
        + (f"near field of {near:g} voxels, " if near > 0.0 else "no near field, ")
        + f"steps of {march.step_ratio:g} footprints, start at "
        f"{march.start_offset_voxels:g}, pull-back {march.pull_back_voxels:g}"
    )


def _walls(*most: float) -> Mapping[float, float]:
    return dict(zip(WALL_VOXELS, most, strict=True))


LEVEL_BIAS, PULL_BACK_VOXELS = -1.0, 0.4
"""A level bias of -0.5 loses 4 % of the Cornell box's light with 64 cones. A pull-back of 0.25
loses 0.6 % (17 cones) and 0.3 % (64) of it, and one of 0.5 makes a square 19 % too bright."""


HIGH = Column(
    name="17 cones",
    # With two voxels of rays, a turned wall of a quarter voxel lets 9 % of the light through.
    cones=preset("high").diffuse,
    limits=Limits(
        energy=(0.92, 1.08),
        phase_energy=(0.90, 1.10),
        relmse=0.030,
        relmse_goal=0.020,
        mre=0.11,
        spread=0.02,
        furnace=0.87,
        furnace_points=(0.78, MOST_FURNACE),
        squares=0.20,
        leaks={
            "axis": _walls(0.05, 0.02, 0.018, 0.016),
            "turned": _walls(0.09, 0.06, 0.045, 0.030),
        },
    ),
)
"""The cones of preset "high", with longer rays and more pull-back."""

ULTRA = Column(
    name="64 cones",
    # With two voxels of rays, such a wall lets 7 % through, with three 4.4 %.
    cones=preset("ultra").diffuse,
    limits=Limits(
        energy=(0.97, 1.03),
        phase_energy=(0.95, 1.05),
        relmse=0.012,
        relmse_goal=0.006,
        mre=0.07,
        spread=0.02,
        furnace=0.92,
        furnace_goal=0.95,
        furnace_points=(0.85, MOST_FURNACE),
        squares=0.20,
        squares_goal=0.10,
        leaks={
            "axis": _walls(0.016, 0.006, 0.006, 0.005),
            "turned": _walls(0.05, 0.03, 0.02, 0.012),
        },
    ),
)
"""The cones of preset "ultra", with longer rays, more pull-back and a finer level."""

COLUMNS = (HIGH, ULTRA)

CLASSIC = Column(name="classic recipe", cones=PEERS["classic"].diffuse, limits=Limits())
"""What most systems do: trilinear alpha, squared direction, exponent. It stands beside."""

PYRAMID = Bench(
    name="pyramid",
    tracers={column.name: column.cones for column in (*COLUMNS, CLASSIC)},
    # A quick study has them all: a wall of a quarter voxel lets through ten times as much at one
    # phase as at another.
    phases=(8, 8),
)
"""A single level of voxels with its mips, over the whole scene, with exact light."""

PYRAMID_WORDS = f"N = {RESOLUTION}, exact light"
