"""`gst change`: what two scans of one surface lost and gained, without a study."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from shell import command

import gstlib

SPACING = 0.004  # mm
POINTS = 160


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A scan before use, the same place again, after a loss of 2 µm on a quarter, and another."""
    folder = tmp_path_factory.mktemp("scans")
    rng = np.random.default_rng(5)
    here, elsewhere = 2e-3 * gaussian_filter(
        rng.normal(size=(2, POINTS, POINTS)), (0, 2, 2)
    )
    worn = here.copy()
    worn[40:120, 40:120] -= 2e-3
    for name, heights in {
        "T0": here,
        "again": here,
        "T1": worn,
        "other": elsewhere,
    }.items():
        noise = 1e-5 * rng.normal(size=heights.shape)
        gstlib.write_plu(folder / f"{name}.plu", heights + noise, SPACING)
    return folder


@pytest.fixture(autouse=True)
def _here(folder, monkeypatch):
    monkeypatch.chdir(folder)


def run(*files):
    return command("change --output change.png", *files)


@pytest.mark.parametrize(
    ("repeat", "source"),
    [([], "unchanged part"), (["--repeat", "again.plu"], "the repeat")],
)
def test_the_loss_of_two_scans(folder, repeat, source):
    result = run("T0.plu", "T1.plu", *repeat)
    assert result.exit_code == 0, result.output
    loss = next(row for row in result.output.splitlines() if row.startswith("loss"))
    percent, volume = float(loss.split()[1]), float(loss.split()[6])
    assert percent == pytest.approx(25, abs=1.5)
    assert volume == pytest.approx(2.0 * 320**2, rel=0.05)  # µm³
    assert source in result.output
    assert (folder / "change.png").stat().st_size > 1000


def test_a_picture_replaces_no_other_and_its_ending_is_known(folder):
    (folder / "T1_change.png").write_text("mine")
    result = command("change T0.plu T1.plu")
    assert result.output.splitlines()[-1].split() == ["picture", "T1_change_2.png"]
    assert (folder / "T1_change.png").read_text() == "mine"
    for words in ("change T0.plu T1.plu", "press T0.plu --pressure 5"):
        result = command(f"{words} --output a.txt")
        assert (result.exit_code, result.stdout) == (2, "")
        assert "'--output': end the name in .png, .svg or .pdf" in result.stderr


def test_moulds_are_turned_over():
    """Scans of moulds that are taken for the stone's show a gain, which is doubted."""
    assert "--mould" in run("T1.plu", "T0.plu").output
    turned = run("T1.plu", "T0.plu", "--mould").output
    assert turned.partition("loss")[2].split()[0].startswith("25")
    assert "NOTE" not in turned


@pytest.mark.parametrize(
    ("scale", "step", "remedy"),
    [
        (10, 1, "Export both scans in one unit"),
        (25.4, 1, "Export both scans in one unit"),
        (1000, 1, "Export both scans in one unit"),
        (1, 2, "Resample one of the two surfaces"),
    ],
)
def test_two_scans_that_cannot_be_subtracted_are_refused(scale, step, remedy):
    """Of another unit, and of another distance of the points."""
    heights = gstlib.read_scan("T1.plu").values[::step, ::step]
    gstlib.write_plu("odd.plu", scale * heights, step * SPACING)
    for pair in (("T0.plu", "odd.plu"), ("odd.plu", "T0.plu")):
        result = run(*pair)
        assert result.exit_code == 2
        assert remedy in result.stderr
        assert "patch" not in result.stderr
        assert "WARNING" not in result.stderr


def test_a_smaller_scan_after_use_is_compared_where_it_lies():
    heights = gstlib.read_scan("T1.plu").values[:120, :120]
    gstlib.write_plu("small.plu", heights, SPACING)
    result = run("T0.plu", "small.plu")
    assert result.exit_code == 0, result.output
    assert "NOTE: the change of the rest of T0 is not measured" in result.stdout


def test_a_doubt_of_the_library_is_a_warning_about_the_file():
    """Heights may be calibrated otherwise, by a factor that wear might leave."""
    heights = 1.4 * gstlib.read_scan("again.plu").values
    gstlib.write_plu("an odd scan.plu", heights, SPACING)
    result = run("T0.plu", "an odd scan.plu")
    assert "WARNING: an odd scan.plu: its dales at T1 are 1.4 times" in result.stderr


@pytest.mark.parametrize("files", [("other.plu",), ("T1.plu", "--repeat", "other.plu")])
def test_a_scan_of_another_surface_is_refused(files):
    result = run("T0.plu", *files)
    assert result.exit_code == 2
    assert "other.plu" in result.output
