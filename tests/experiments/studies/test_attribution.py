"""The renderers of the attribution study: as it is, partly exact, and all exact."""

from __future__ import annotations

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

import reference
import vctgi
from experiments.scenes import load_scene
from experiments.studies.attribution import checks
from experiments.studies.attribution.figures import add_waterfall
from experiments.studies.attribution.gathering import Gatherer
from experiments.studies.attribution.pictures import (
    Effort,
    Volumes,
    make_volumes,
    render_batches,
    that_matters,
)
from experiments.studies.attribution.stages import STAGES, Exact, first_exact, last_exact
from experiments.studies.attribution.voxels import exact_light
from experiments.studies.figures import FigureShelf
from metrics.attribution import attribute_error
from vctgi.clipmap.levels import ClipmapConfig
from vctgi.clipmap.storage import StorageConfig, pack_volume
from vctgi.pipeline import voxelize_scene
from vctgi.prepared import PreparedScene
from vctgi.stages.cone_tracing.diffuse import DiffuseConesConfig
from vctgi.stages.downsampling import downsample

EDGE = 12
BATCHES = 6
EFFORT = Effort(batch_count=BATCHES, marched_rays=1, traced_rays=16, sparse_repeats=1)

STANDARD_ERRORS = 4.0
"""By which two estimates of one mean may differ: one in several thousand does."""

CONFIG = replace(vctgi.preset("medium"), clipmap=ClipmapConfig(resolution=32), samples_per_pixel=2)


@pytest.fixture
def box(variant: str) -> tuple[PreparedScene, Volumes]:
    """Return the Cornell box in coarse voxels."""
    scene = load_scene("cornell_box", resolution=EDGE).scene
    prepared = vctgi.prepare_scene(scene, scene.sensors()[0], CONFIG)
    return prepared, make_volumes(prepared, CONFIG)


def _pictures(
    box: tuple[PreparedScene, Volumes], exact: Exact, effort: Effort = EFFORT
) -> np.ndarray:
    return render_batches(*box, CONFIG, exact, effort, lambda _share: None)


def _truth(prepared: PreparedScene) -> np.ndarray:
    request = reference.ReferenceRequest(
        samples_per_pixel=1536, batch_count=BATCHES, rest_samples_per_pixel=0
    )
    found = reference.render_reference(prepared.scene, request=request, cache_directory=None)
    return found.batches("indirect_diffuse").astype(np.float64)


def test_nothing_exact_is_the_renderer(box: tuple[PreparedScene, Volumes]) -> None:
    """With no stage replaced, pictures are those of the renderer."""
    prepared, volumes = box
    effort = replace(EFFORT, batch_count=2)
    found = render_batches(prepared, volumes, CONFIG, Exact(), effort, lambda _share: None)
    for seed, picture in enumerate(found):
        volume = volumes.of(Exact())
        frame = vctgi.render_frame(prepared, volume, CONFIG, seed=seed)
        expected = np.array(frame.indirect_diffuse)
        np.testing.assert_allclose(picture, expected, rtol=1e-5, atol=1e-7)


def test_the_ledger_closes(box: tuple[PreparedScene, Volumes]) -> None:
    """With everything replaced the pictures are the path tracer's, within the noise of both."""
    prepared, _ = box
    start, end = _pictures(box, Exact()), _pictures(box, first_exact(len(STAGES)))
    truth = _truth(prepared)
    chain = [start, end]
    energy = attribute_error("energy", ["all"], chain, chain, truth)
    relmse = attribute_error("relmse", ["all"], chain, chain, truth)
    for attribution in (energy, relmse):
        half = 0.5 * (attribution.end.high - attribution.end.low)
        # Half an interval is 2.57 standard errors for 6 batches.
        assert abs(attribution.end.value) < STANDARD_ERRORS / 2.57 * half
    assert energy.end.high - energy.end.low < 0.1
    shelf = FigureShelf()
    add_waterfall(shelf, "box", energy, relmse)
    (figure,) = shelf.figures
    assert figure.kind == "waterfall"
    assert [panel.end.value for panel in figure.panels] == [energy.end.value, relmse.end.value]


def test_a_fault_of_voxels_stays_with_them(box: tuple[PreparedScene, Volumes]) -> None:
    """Voxels of half the light make half a picture by voxels, and do not touch the exact one."""
    prepared, volumes = box
    opacity = voxelize_scene(prepared, CONFIG).opacity
    light = exact_light(prepared, opacity, 1)
    dim = replace(light, levels=[0.5 * level for level in light.levels])
    merged, lit = downsample(opacity, dim)
    assert lit is not None
    faulty = Volumes(dict.fromkeys(volumes.by_key, pack_volume(merged, lit)))
    by_voxels = Exact(light=True, pixels=True, width=True, directions=True, visibility=True)
    few = replace(EFFORT, batch_count=1, traced_rays=1)
    whole, half = (_pictures((prepared, each), by_voxels, few).mean() for each in (volumes, faulty))
    assert half == pytest.approx(0.5 * whole, rel=1e-3)
    everything = first_exact(len(STAGES))
    dimmed = _pictures((prepared, faulty), everything, few)
    np.testing.assert_array_equal(dimmed, _pictures(box, everything, few))


def test_orders_meet() -> None:
    """Both orders begin with nothing and end with everything; each step changes one stage."""
    assert first_exact(0) == last_exact(0) == Exact()
    assert first_exact(len(STAGES)) == last_exact(len(STAGES))
    for order in (first_exact, last_exact):
        for count in range(len(STAGES)):
            before, after = vars(order(count)), vars(order(count + 1))
            assert sum(before[name] != after[name] for name in STAGES) == 1


def test_what_does_not_matter_is_not_run() -> None:
    """A path tracer knows no voxels; 32-bit storage is exact already."""
    assert that_matters(first_exact(len(STAGES)), CONFIG) == Exact(
        pixels=True, directions=True, visibility=True, radiance=True
    )
    exact = replace(CONFIG, storage=StorageConfig())
    assert that_matters(Exact(storage=True), exact) == Exact()
    if not (mi.variant() or "").startswith("cuda"):
        assert that_matters(Exact(storage=True), CONFIG) == Exact()


def test_unknown_cones_are_refused(box: tuple[PreparedScene, Volumes]) -> None:
    """A set of another system has no solid angles of its own."""
    prepared, volumes = box
    with pytest.raises(ValueError, match="ring sets"):
        Gatherer(
            scene=prepared.scene,
            volume=volumes.of(Exact()),
            cones=DiffuseConesConfig(cone_set="compix16", cone_count=16),
            scattering_count=1,
            exact=Exact(),
        )


def test_rows_are_complete(variant: str) -> None:
    """Every stage has a row in each order, and every scene has one that closes its ledger."""
    names = [check.name for check in checks()]
    assert sum("forward" in name for name in names) == sum("backward" in name for name in names)
    assert sum("left over, standard errors" in name for name in names) == 8
