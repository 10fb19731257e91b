"""What the artefact studies draw, from synthetic measurements whose maps are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from experiments.errors import InputError
from experiments.studies.aliasing.figures import add_sweep_figures
from experiments.studies.banding import chosen_scene
from experiments.studies.banding.maps import add_spread_map
from experiments.studies.catalogue import STUDIES, checks_of, definitions_of, find_study
from experiments.studies.check import StudyContext
from experiments.studies.figures import FigureShelf
from experiments.studies.flicker.maps import add_flicker_maps
from experiments.studies.leaking.maps import add_audit_maps, add_excess_maps
from metrics.flicker import Motion
from metrics.leaking import LeakAudit
from reports.image_files import load_image_file
from reports.study_figures import MapFigure
from reports.study_page import STUDY_ORDER

SINGLE = 1e-6
"""Relative: maps are stored in single precision."""


@pytest.fixture
def shelf(tmp_path: Path) -> FigureShelf:
    return FigureShelf(tmp_path / "maps")


def maps(shelf: FigureShelf, folder: Path) -> dict[str, np.ndarray]:
    """Return the values of all maps by their titles."""
    return {
        figure.title: load_image_file(folder, figure.file, "again")
        for figure in shelf.figures
        if isinstance(figure, MapFigure)
    }


def test_parts_of_a_leak_add_up_on_their_maps(shelf: FigureShelf, tmp_path: Path) -> None:
    truth = np.ones((3, 2, 4))
    through, gathered = np.zeros_like(truth), np.ones_like(truth)
    # One pixel gains half as much through a wall, one is twice as bright, one is dark.
    through[:, 0, 0], gathered[:, 0, 0] = 0.5, 1.5
    gathered[:, 1, 1], gathered[:, 1, 3] = 2.0, 0.0
    audit = LeakAudit(gathered=gathered, through=through, truth=truth)
    add_audit_maps(shelf, "rooms", audit)
    found = maps(shelf, tmp_path)
    assert found["Light from behind the true hit"][0, 0] == 0.5
    assert found["Light of the wrong face"][1, 1] == 1.0
    assert found["Over-occlusion"][1, 3] == 1.0
    assert found["Leaked share"].sum() == pytest.approx(0.5 / 1.5 + 0.5, rel=SINGLE)


def test_excess_is_where_it_should_be_dark(shelf: FigureShelf, tmp_path: Path) -> None:
    batches = np.ones((4, 2, 4, 3))
    batches[:, :, 2:] = 0.0
    light = np.full((2, 4, 3), 0.25)
    add_excess_maps(shelf, "rooms", light, batches)
    found = maps(shelf, tmp_path)
    expected = np.repeat([[0.0, 0.0, 0.25, 0.25]], 2, axis=0)
    np.testing.assert_allclose(found["Light where it should be dark"], expected, atol=SINGLE)
    expected = np.repeat([[0.75, 0.75, 0.0, 0.0]], 2, axis=0)
    np.testing.assert_allclose(found["Missing light"], expected, atol=SINGLE)
    assert [figure.kind for figure in shelf.figures[:2]] == ["picture", "picture"]


def test_a_spread_is_relative_to_the_mean_light(shelf: FigureShelf, tmp_path: Path) -> None:
    pictures = np.stack([np.full((2, 2), 2.0 + each) for each in (-1.0, 0.0, 1.0)])
    mask = np.array([[True, True], [True, False]])
    add_spread_map(shelf, "floor", "off", pictures, mask)
    expected = np.where(mask, 0.5, 0.0)
    np.testing.assert_allclose(maps(shelf, tmp_path)["off"], expected, rtol=SINGLE)


def test_flicker_is_what_the_truth_does_not_do(shelf: FigureShelf, tmp_path: Path) -> None:
    still = np.full((3, 4, 4, 3), 0.5)
    blinking = still.copy()
    blinking[1, 1, 1] = 1.0
    rows, columns = np.mgrid[0:4, 0:4] + 0.5
    places = np.repeat(np.stack([columns, rows], axis=-1)[None], 2, axis=0)
    followed = np.zeros((2, 4, 4), np.bool_)
    followed[:, 1:3, 1:3] = True
    frames = {(4, False): blinking, (4, True): still}
    add_flicker_maps(shelf, "box", frames, np.stack([still, still]), Motion(places, followed))
    found = maps(shelf, tmp_path)
    # Up by the mean light and down again.
    assert found["N = 4, single frames"][1, 1] == pytest.approx(1.0, rel=SINGLE)
    assert np.count_nonzero(found["N = 4, single frames"]) == 1
    assert not found["N = 4, accumulated"].any()


def test_changes_beyond_the_truth_are_maps_of_two_hues(shelf: FigureShelf, tmp_path: Path) -> None:
    places = np.arange(4) / 4.0
    truth = np.ones((3, 4, 5, 3))
    popping = truth[0].copy()
    popping[2:, 3] += 0.5
    light = {"scatter": truth[0], "centre": popping}
    powers = {how: np.ones(4) for how in light}
    add_sweep_figures(shelf, "moved", places, powers, light, truth)
    curves = [figure for figure in shelf.figures if figure.kind == "curve"]
    assert [len(curve.series) for curve in curves] == [2, 2]
    assert all(f.low == -f.high for f in shelf.figures if isinstance(f, MapFigure))
    found = maps(shelf, tmp_path)
    assert not found["Changes beyond the truth's, scatter"].any()
    changes = found["Changes beyond the truth's, centre"]
    assert np.count_nonzero(changes) == 1
    assert changes[1, 3] == pytest.approx(0.5, rel=SINGLE)


@pytest.mark.usefixtures("variant")
def test_a_scene_without_gloss_is_refused_in_one_line() -> None:
    context = StudyContext(quick=True, progress=lambda _step, _share: None, scene="cornell_box")
    with pytest.raises(InputError, match="no glossy surface"):
        chosen_scene.checks()[0].measure(context)


@pytest.mark.usefixtures("variant")
@pytest.mark.parametrize("name", STUDY_ORDER)
def test_each_artefact_says_what_its_numbers_are_and_which_come_first(name: str) -> None:
    entry = find_study(name)
    assert definitions_of(entry)
    found = checks_of(entry)
    assert any(check.is_headline for check in found)
    assert name in STUDIES
