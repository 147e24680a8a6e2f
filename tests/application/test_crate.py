"""`gst package`: what is in the zip, what it says of it, and what is refused."""

import hashlib
import json
import os
import re
import zipfile
from pathlib import Path
from urllib.parse import unquote

import gstlib
import pytest
import yaml
from click.testing import CliRunner
from gst.chain import given_to, step_of, write_record
from gst.cli import main
from gst.crate import pack_study
from gst.provenance import program_hash
from gstlib.errors import InputError
from gstlib.io.files import sha256

ROOT = Path(__file__).parents[2]
RESULTS = {
    "index.html": b"<html>",
    "tables/wear.csv": b"patch\n5\n",
    "figures/wear.png": b"\x89PNG",
}
LEFT_OUT = {"microscale/5.h5": b"fields", "tables/old.csv": b"of another config", "check.png": b""}
INPUTS = {
    "config/patches ü.tsv": b"patch\tt0\n5\ta.plu\n",
    "data/a.plu": b"heights",
    "gone.stl": b"",
    "config/poses.tsv": b"x_mm\n0.1\n",
    "config/published.csv": b"patch\n5\n",
}


def write(folder, files):
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def record(folder, specimen=None, results="out/results", **given):
    """A study of measured files, or with a section `specimen` of generated ones."""
    patches, _, _, poses, published = INPUTS
    config = {"results": results, "title": "a & b", "patches": patches}
    config |= {"published": published, "gesture": {"table": poses}, "specimen": specimen}
    inputs = {name: hashlib.sha256(content).hexdigest() for name, content in INPUTS.items()}
    software = {"gstlib": gstlib.__version__, "commit": None, "python": "3.11"}
    software |= {"program": program_hash()} | given
    software["packages"] = {"numpy": "2.0", "snakemake": "9.0"}
    content = {"config": config, "inputs": inputs, "software": software}
    (folder / "provenance.json").write_text(json.dumps(content))
    made = [folder / name for name in (*RESULTS, "contents.json", "provenance.json")]
    read = [Path(name) for name, content in INPUTS.items() if content]
    step = step_of(folder / "logs/write_page.log", {"steps": {}}, read, made)
    write_record(folder, step, given_to(folder, step), {})


@pytest.fixture
def results(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where the study ran
    folder = tmp_path / "out/results"
    write(folder, RESULTS | LEFT_OUT)
    write(tmp_path, {name: content for name, content in INPUTS.items() if content})
    said = {"category": "5 Validation", "caption": "<p>Loss &amp;\n<em>pressure</em>.</p>"}
    contents = [
        said | {"file": name, "title": f"title of {name}", "sha256": sha256(folder / name)}
        for name in RESULTS
    ]
    (folder / "contents.json").write_text(json.dumps(contents))
    record(folder)
    return folder


def packed(results, **options):
    """The files of the zip, its entities, and the action among them."""
    target = results.parent / "study.zip"
    count = pack_study(results, target, **options)
    with zipfile.ZipFile(target) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    assert count == sum(not name.endswith("/") for name in files)
    graph = json.loads(files.pop("ro-crate-metadata.json"))["@graph"]
    entities = {entity["@id"]: entity for entity in graph}
    assert len(entities) == len(graph)
    return files, entities, entities["#study"]


def test_every_file_is_described_and_everything_described_is_there(results):
    files, entities, action = packed(results)
    described = {unquote(name) for name, one in entities.items() if "File" in one["@type"]}
    folders = {name for name, one in entities.items() if one["@type"] == "Dataset"} - {"./"}
    assert described == {name for name in files if not name.startswith(tuple(folders))}
    assert folders == {name for name in files if name.endswith("/")}
    parts = {one["@id"] for one in entities["./"]["hasPart"]}
    assert {unquote(part) for part in parts} == described | folders
    for entity in entities.values():
        if "File" in entity["@type"]:
            content = files[unquote(entity["@id"])]
            assert entity["sha256"] == hashlib.sha256(content).hexdigest()
            assert entity["contentSize"] == str(len(content))
    referred = re.findall(r'"@id": "([^"]*)"', json.dumps([*entities.values()]))
    assert {name for name in referred if "://" not in name} <= set(entities)
    assert {f"results/{name}" for name in RESULTS} <= {one["@id"] for one in action["result"]}
    assert action["instrument"] == entities["./"]["mainEntity"] == {"@id": "Snakefile"}
    assert "workflow/rules/common.smk" in files
    wear = entities["results/tables/wear.csv"]
    assert wear["name"] == "Validation: title of tables/wear.csv"
    assert wear["description"] == "Loss & pressure."
    assert not any(name.endswith((".h5", "old.csv", "check.png", ".plu")) for name in files)
    assert "Left out" in entities["./"]["description"]


def test_inputs_are_known_by_their_hash_and_tables_are_packed(results):
    files, entities, action = packed(results)
    patches, scan, mesh, *others = INPUTS
    tables = {patches, *others}
    assert {name: files[name] for name in tables} == {name: INPUTS[name] for name in tables}
    assert entities[f"#{scan}"]["sha256"] == hashlib.sha256(INPUTS[scan]).hexdigest()
    used = {unquote(one["@id"]) for one in action["object"]}
    assert used == {"config/study.yaml", *tables, f"#{scan}", f"#{mesh}"}
    provenance = json.loads(files["results/provenance.json"])
    assert yaml.safe_load(files["config/study.yaml"]) == provenance["config"]


def test_a_generated_specimen_cannot_pass_for_a_real_tool(results):
    files, entities, _ = packed(results)
    assert "generated" not in json.dumps(entities["./"]) + files["README.md"].decode()
    record(results, specimen={"seed": 7})
    files, entities, action = packed(results)
    whole = entities["./"]
    assert "synthetic specimen" in whole["name"]
    assert "synthetic specimen" in whole["keywords"]
    assert {"@id": "#specimen"} in action["object"]
    for text in (whole["description"], files["README.md"].decode()):
        assert "says anything about a real tool" in text


def test_the_run_ends_with_its_newest_result_and_has_the_authors_given(results):
    for number, file in enumerate(sorted(results.rglob("*.*"))):
        os.utime(file, (0, 1_000_000_000 + number % 3))
    _, entities, action = packed(results)
    assert action["endTime"] == "2001-09-09T01:46:42+00:00"
    assert entities["./"]["datePublished"] == "2001-09-09"
    assert "author" not in entities["./"]
    assert "None is stated" in entities["./"]["license"]
    assert entities["Snakefile"]["license"] == {"@id": "https://spdx.org/licenses/MIT"}
    _, entities, action = packed(results, authors=["Ada Lovelace"], licence="CC-BY-4.0")
    assert entities[action["agent"]["@id"]]["name"] == "Ada Lovelace"
    assert entities["./"]["author"] == action["agent"]
    assert entities[entities["./"]["license"]["@id"]]["name"] == "CC-BY-4.0"


def from_elsewhere():
    """A folder of somebody else, whose records fit each other."""
    contents = Path("out/results/contents.json")
    contents.write_text(contents.read_text().replace("tables/wear.csv", "../../private"))
    record(Path("out/results"))


# What is done to a finished study in `out/results`, and what is said of it.
DAMAGED = {
    "unfinished": (lambda: Path("out/results/contents.json").unlink(), "contents.json"),
    "another program": (
        lambda: record(Path("out/results"), commit="abc", program=""),
        "commit abc",
    ),
    "result gone": (lambda: Path("out/results/figures/wear.png").unlink(), "wear.png"),
    "result": (lambda: Path("out/results/tables/wear.csv").write_text("other"), "wear.csv"),
    "input": (lambda: Path("data/a.plu").write_text("other"), "data/a.plu"),
    "contents from elsewhere": (from_elsewhere, "outside the results: ../../private"),
    "elsewhere": (lambda: os.chdir("/"), "patches ü.tsv: this table of the study is missing"),
}


@pytest.mark.parametrize("what", DAMAGED)
def test_what_is_no_finished_study_is_refused(results, tmp_path, what):
    damage, said = DAMAGED[what]
    damage()
    with pytest.raises(InputError, match=said):
        pack_study(results, tmp_path / "study.zip")
    assert not (tmp_path / "study.zip").exists()


def test_the_command_writes_the_same_bytes_each_time(results):
    written = []
    for folder in ("out/results", results):
        said = CliRunner().invoke(main, ["package", str(folder)])
        assert said.exit_code == 0, said.output
        written.append(Path("results.zip").read_bytes())
        Path("results.zip").unlink()
    assert written[0] == written[1]


def test_metadata_for_archives_agree():
    cff = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    zenodo = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    assert cff["version"] == gstlib.__version__
    assert zenodo["description"] == cff["abstract"]
    for key in ("title", "license", "keywords"):
        assert zenodo[key] == cff[key]
    assert zenodo["creators"] == [{"name": author["name"]} for author in cff["authors"]]
    (related,) = zenodo["related_identifiers"]
    assert related["identifier"] == cff["preferred-citation"]["doi"]
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert f'license = "{cff["license"]}"' in project
