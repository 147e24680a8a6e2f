"""Results packed as an RO-Crate: every file in it, and where they come from."""

import json
import zipfile

import pytest
import yaml
from click.testing import CliRunner
from rocrate.rocrate import ROCrate

from gstlib.cli import main
from gstlib.crate import write_crate
from gstlib.errors import InputError

RECORD = {
    "config": {"title": "a stone", "macroscale": {"grid": 100}},
    "inputs": {"data/mesh.stl": "ab" * 32, "config/patches.tsv": "cd" * 32},
    "software": {
        "gstlib": "0.1.0",
        "commit": "ef" * 20,
        "python": "3.11.7",
        "packages": {"numpy": "2.4.6", "scipy": "1.17.0"},
    },
}
TABLES = {
    "tables/patch_pressures.csv": "patch,in_study\n1,yes\n2,no\n",
    "tables/registration.csv": "patch,found\n1,yes\n",
} | {
    f"tables/{name}.csv": "patch\n"
    for name in (
        *("inputs", "preprocessing", "outliers", "gridding", "macroscale_path", "placement"),
        *("patch_intervals", "texture", "microscale_summary"),
        *("validation_patches", "validation_summary"),
    )
}
FIGURES = {"figures/overview.png", "figures/validation.png", "figures/patch/1.png"}
PACKED = {"provenance.json", "report.html", "tables/a.csv", *TABLES, *FIGURES}


@pytest.fixture
def results(tmp_path):
    folder = tmp_path / "results"
    for name in (*PACKED, "microscale/1.h5", "figures/b.svg"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        known = TABLES | {"provenance.json": json.dumps(RECORD)}
        (folder / name).write_text(known.get(name, name))
    return folder


def test_files_and_where_they_come_from(results, tmp_path):
    archive = tmp_path / "out/study.zip"
    assert write_crate(results, archive) == len(PACKED)
    with zipfile.ZipFile(archive) as packed:
        assert set(packed.namelist()) > PACKED
        assert packed.read("tables/a.csv") == b"tables/a.csv"
        assert "microscale/1.h5" not in packed.namelist()
    crate = ROCrate(archive)
    assert crate.name == "a stone"
    study = crate.root_dataset["mentions"]
    assert {file.id for file in study["result"]} == PACKED
    assert study["instrument"]["softwareVersion"] == "0.1.0"
    assert study["instrument"]["identifier"] == "ef" * 20
    assert "numpy 2.4.6" in study["instrument"]["softwareRequirements"]
    hashes = {one["name"]: one["sha256"] for one in study["object"] if "sha256" in one}
    assert hashes == RECORD["inputs"]
    settings = {one["name"]: one["value"] for one in study["object"] if "value" in one}
    assert json.loads(settings["macroscale"]) == {"grid": 100}


def test_what_cannot_be_packed(results, tmp_path):
    with pytest.raises(InputError, match=r"is no \.zip"):
        write_crate(results, tmp_path / "study.tar")
    (results / "provenance.json").unlink()
    said = CliRunner().invoke(main, ["crate", str(results), str(tmp_path / "study.zip")])
    assert said.exit_code == 1
    assert "Name the results folder of a finished study" in said.output
    assert not (tmp_path / "study.zip").exists()


@pytest.mark.parametrize(
    "name",
    [
        *("report.html", "tables/texture.csv", "tables/patch_pressures.csv"),
        *("tables/microscale_summary.csv", "tables/validation_summary.csv"),
        "figures/validation.png",
    ],
)
def test_a_study_that_has_not_run_to_its_end_is_not_packed(results, tmp_path, name):
    (results / name).unlink()
    with pytest.raises(InputError, match=rf"no finished study: {name} missing.*\n*.*make study"):
        write_crate(results, tmp_path / "study.zip")
    assert not (tmp_path / "study.zip").exists()


def test_a_study_without_patches_or_without_t1_is_finished_without_their_tables(results, tmp_path):
    for name in ("registration", "validation_patches", "validation_summary"):
        (results / f"tables/{name}.csv").unlink()
    (results / "figures/validation.png").unlink()
    assert write_crate(results, tmp_path / "without_t1.zip") == len(PACKED) - 4
    (results / "tables/patch_pressures.csv").write_text("patch,in_study\n1,no\n")
    for name in ("tables/microscale_summary.csv", "figures/overview.png"):
        (results / name).unlink()
    assert write_crate(results, tmp_path / "without_patches.zip") == len(PACKED) - 6


def test_the_config_to_make_results_again(results, tmp_path):
    said = CliRunner().invoke(main, ["config", str(results)])
    assert said.exit_code == 0
    assert said.output.startswith(f"# gstlib 0.1.0, commit {'ef' * 20}\n")
    assert yaml.safe_load(said.output) == RECORD["config"]
    said = CliRunner().invoke(main, ["config", str(tmp_path)])
    assert said.exit_code == 1
    assert "provenance.json: cannot be read" in said.output
