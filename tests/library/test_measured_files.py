"""Measured files through readers, gridding and preparation (skipped where they are absent).

What the files are, and whose, is in the PROVENANCE.md beside them; none is part of the project.
"""

from pathlib import Path

import numpy as np
import pytest
from power import specimen_config
from sweep import study_of

from gstlib.coupling import orientations, placement
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from gstlib.io.stage import stage_of
from gstlib.surfaces.grid import spacing_of

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"the measured files are not beside the project ({DATA})"
)

PLU = DATA / "surfacetopography-mit/plu-1.plu"
LEICA = DATA / "surfalize-gpl3/leica-dcm3d-test_1.plu"
ALICONA = DATA / "surfacetopography-mit/al3d-1.al3d"


@pytest.mark.parametrize(
    ("path", "shape", "start", "unit_mm", "spacing", "stage_mm"),
    [
        # a stage's place is in µm: in mm, that of the second would have moved by 58 m
        (PLU, (576, 768), 508, 1e-3, 1.66e-3, (-0.05216003, -6.04268)),
        (LEICA, (576, 768), 508, 1e-3, 0.332e-3, (-58.20761, -0.121776)),
        # where its heights start is in its own header
        (ALICONA, (296, 200), 1261, 1e3, 0.438027e-3, None),
    ],
)
def test_scans_are_read_as_their_bytes_say(
    path, shape, start, unit_mm, spacing, stage_mm
):
    count = shape[0] * shape[1]
    raw = np.frombuffer(path.read_bytes(), "<f4", count, start).reshape(shape)
    scan = read_scan(path)
    np.testing.assert_allclose(scan.values, raw.astype(float) * unit_mm, rtol=1e-9)
    assert spacing_of(scan) == pytest.approx((spacing, spacing), rel=1e-6)
    assert stage_of(scan) == (stage_mm and pytest.approx(stage_mm, rel=1e-6))


@pytest.fixture(scope="module")
def stone():
    return read_mesh(DATA / "pebble-mesh-3dhop/lithic_tool_model_full.ply")


def test_nothing_of_a_mesh_is_lost(stone):
    sheet = read_mesh(DATA / "grasselli-mit/example_surface.stl")
    assert (len(stone.vertices), len(stone.faces)) == (223643, 447278)
    assert (len(sheet.vertices), len(sheet.faces)) == (8599, 16672)
    assert stone.extents == pytest.approx([44.5, 55.4, 48.5], abs=0.06)
    assert sheet.extents == pytest.approx([21.7, 27.6, 2.30], abs=0.06)
    # the stone's coordinates are multiples of a 64th of a millimetre
    assert stone.metadata["step_mm"] == 1 / 64


@pytest.fixture(scope="module")
def pebble(stone):
    """The study of the measured pebble."""
    files = "config/config.yaml", "config/pebble.yaml"
    study = study_of(specimen_config(*(ROOT / file for file in files)), ROOT)
    study.read_mesh = lambda: stone
    return study


@pytest.mark.parametrize("mistake", [*orientations.TABLES][::3])
def test_a_mistaken_table_of_the_pebble_is_named(pebble, mistake, caplog):
    table, settings = pebble.patches, pebble.settings["check_placement"]
    scans = {patch: pebble.prepared[patch, "T0"] for patch in table.patch}
    x, y = orientations.as_measured(table.x_mm, table.y_mm, 5.0, mistake)
    places = placement.check_placement(
        pebble.face.height,
        table.assign(x_mm=x, y_mm=y),
        scans,
        **settings | {"accept": [placement.FAULT]},
    )
    named = places.orientation.iloc[-1].removeprefix("with ")
    faults = [record for record in caplog.records if record.levelname == "ERROR"]
    assert len(faults) == bool(mistake)
    if mistake:
        right = orientations.as_measured(x, y, 5.0, named)
        np.testing.assert_allclose(right, (table.x_mm, table.y_mm))
    else:
        assert named == orientations.AS_GIVEN
