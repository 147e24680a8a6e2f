"""`gst package`: the contents of the zip, and the results that it refuses."""

import contextlib
import hashlib
import json
import os
import shutil
import zipfile
from pathlib import Path

import pytest
import yaml
from folders import fill, snapshot
from shell import command

import gstlib
from gst import ROOT
from gst.run.chain import given_to, step_of, write_record
from gst.run.provenance import program_hash, study_provenance
from gst.share.package import pack_study
from gstlib.errors import InputError
from gstlib.io.files import sha256

RESULTS = {
    "index.html": b"<html>",
    "tables/wear.csv": b"patch\n5\n",
    "figures/wear.png": b"\x89PNG",
}
LEFT_OUT = {
    "microscale/5.h5": b"fields",
    "tables/old.csv": b"of another config",
    "check.png": b"",
}
INPUTS = {
    "config/patches ü.tsv": b"patch\tt0\n5\ta.plu\n",
    "data/a.plu": b"heights",
    "gone.stl": b"",
    "config/poses.tsv": b"x_mm\n0.1\n",
    "config/published.csv": b"patch\n5\n",
}


def record(folder, specimen=None, program=None):
    """A study of measured files, or with a section `specimen` of generated ones."""
    patches, _, _, poses, published = INPUTS
    config = {
        "results": "out/results",
        "title": "a & b",
        "patches": patches,
        "published": published,
        "gesture": {"table": poses},
        "specimen": specimen,
        "inputs": None,
        "scans": {"size_mm": 0.85},
    }
    inputs = {
        name: hashlib.sha256(content).hexdigest() for name, content in INPUTS.items()
    }
    versions = {"python": "3.11", "numpy": "2.0", "snakemake": "9.0"}
    program = program or program_hash()
    content = study_provenance(config, inputs, "abc", program, versions)
    (folder / "provenance.json").write_text(json.dumps(content))
    made = [folder / name for name in (*RESULTS, "provenance.json")]
    read = [Path(name) for name, content in INPUTS.items() if content]
    step = step_of(folder / "logs/write_page.log", {"steps": {}}, read, made)
    write_record(folder, step, given_to(folder, step), {})


@pytest.fixture
def results(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where the study ran
    return study_in(tmp_path)


def study_in(working):
    """The results of a finished study in a working folder."""
    folder = working / "out/results"
    fill(folder, RESULTS | LEFT_OUT)
    fill(working, {name: content for name, content in INPUTS.items() if content})
    record(folder)
    return folder


def packed(results, **options):
    """The files of the zip."""
    target = results.parent / "study.zip"
    count = pack_study(results, target, **options)
    with zipfile.ZipFile(target) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    assert count == len(files)
    return files


def test_the_files_of_a_package(results):
    files = packed(results)
    patches, *_, poses, published = INPUTS
    for name in (patches, poses, published):
        assert files[name] == INPUTS[name]
    names = {f"results/{name}" for name in (*RESULTS, "provenance.json", PAGE_RECORD)}
    assert {name for name in files if name.startswith("results/")} == names
    assert {"Snakefile", "workflow/rules/common.smk", "src/gst/cli.py"} <= files.keys()
    assert not any(name.endswith((".h5", ".plu")) for name in files)
    provenance = json.loads(files["results/provenance.json"])
    assert provenance["inputs"].keys() == INPUTS.keys()
    assert yaml.safe_load(files["config/study.yaml"]) == provenance["config"]


@pytest.mark.parametrize("specimen", [None, {"seed": 7}])
def test_the_readme_names_authors_licence_and_a_generated_specimen(results, specimen):
    """Which cannot pass for a real tool."""
    record(results, specimen=specimen)
    files = packed(results, authors=["Ada Lovelace"], licence="CC-BY-4.0")
    text = files["README.md"].decode()
    assert ("do not apply to a real tool" in text) == (specimen is not None)
    assert "Ada Lovelace" in text
    assert "CC-BY-4.0" in text


def edit_record(name, change):
    """Change a JSON file of the results, and let the page's record fit it."""
    file, page = (Path("out/results", each) for each in (name, PAGE_RECORD))
    file.write_bytes(change(json.loads(file.read_text())))
    if file != page and file.is_file():
        whole = json.loads(page.read_text())
        whole["outputs"][name] = sha256(file)
        page.write_text(json.dumps(whole))


def name_table(path, digest=None):
    """Let the provenance name a file as the patch table, with its digest in the page's record."""

    def with_table(provenance):
        provenance["config"]["patches"] = path
        provenance["inputs"][path] = sha256(path)
        return json.dumps(provenance).encode()

    def with_digest(page):
        page["files"][path] = digest or sha256(path)
        return json.dumps(page).encode()

    edit_record("provenance.json", with_table)
    edit_record(PAGE_RECORD, with_digest)


def link_table():
    Path("config/link.tsv").symlink_to("/etc/passwd")
    name_table("config/link.tsv")


PAGE_RECORD = "logs/write_page.json"
STUDY = Path("out/results")


# What is done to a finished study in `out/results`, and the problem that is named.
DAMAGED = {
    "commit abc": lambda: record(STUDY, program="another"),
    "wear.csv": lambda: (STUDY / "tables/wear.csv").write_text("other"),
    "/etc/passwd": lambda: name_table("/etc/passwd"),
    "link.tsv": link_table,
    "a.plu": lambda: name_table("data/a.plu", "00"),
    "patches ü.tsv: this table of the study is missing": lambda: os.chdir("/"),
}


@pytest.mark.parametrize("problem", DAMAGED)
def test_what_is_no_finished_study_is_refused(results, tmp_path, problem):
    DAMAGED[problem]()
    with pytest.raises(InputError, match=problem):
        pack_study(results, tmp_path / "study.zip")
    assert not (tmp_path / "study.zip").exists()


HOSTILE = [
    "provenance.json",
    PAGE_RECORD,
    "tables",
    "tables/wear.csv",
    "../../config/published.csv",
    "../../packed.zip",
]
SPOIL = {
    "link": lambda file, private: file.symlink_to(private / "key"),
    "loop": lambda file, _: file.symlink_to(file.name),
    "pipe": lambda file, _: os.mkfifo(file),
    "folder": lambda file, _: file.mkdir(),
    "of somebody else": lambda file, _: file.write_bytes(b"patch\n7\n"),
}
# JSON that no study writes, in a record of the results.
BAD_JSON = {
    "list": ("provenance.json", b"[1, 2]"),
    "deep": ("provenance.json", b"[" * 100_000 + b"]" * 100_000),
    "no text": ("provenance.json", b"\xff\xfe{"),
    "no steps": (
        PAGE_RECORD,
        b'{"params": {"makes": []}, "inputs": {}, "outputs": {}}',
    ),
}


def spoil_file(results, private, name, how):
    file = results / name
    if file.is_dir():
        shutil.rmtree(file)
    file.unlink(missing_ok=True)
    file.parent.mkdir(exist_ok=True)
    SPOIL[how](file, private)


def run_all(working, spoil):
    """Every command that takes results: none ends otherwise than documented or does harm."""
    private, study = working / "private", working / "study"
    fill(private, {"key": b"SECRET"})
    study_in(study)
    with contextlib.chdir(study):
        spoil(Path("out/results"), private)
        before = snapshot(working)
        for words in (
            "package out/results --output packed.zip",
            "export out/results",
            "diff out/results out/results",
        ):
            result = command(words)
            assert isinstance(result.exception, SystemExit | None), words
            assert result.exit_code in (0, 2), words
            assert "SECRET" not in result.output
        after = snapshot(working)
    assert {file: after[file] for file in before} == before
    packed = study / "packed.zip"
    assert after.keys() - before.keys() <= {packed}
    if packed in after and packed not in before:
        with zipfile.ZipFile(packed) as archive:
            assert not any(
                b"SECRET" in archive.read(name) for name in archive.namelist()
            )


@pytest.mark.parametrize("how", SPOIL)
@pytest.mark.parametrize("name", HOSTILE)
def test_no_hostile_file_is_read_replaced_or_waited_for(tmp_path, name, how):
    run_all(tmp_path, lambda results, private: spoil_file(results, private, name, how))


@pytest.mark.parametrize("kind", BAD_JSON)
def test_whatever_json_is_in_results_is_refused_in_a_sentence(tmp_path, kind):
    name, content = BAD_JSON[kind]
    run_all(tmp_path, lambda *_: edit_record(name, lambda _: content))


def test_the_package_has_the_same_bytes_each_time(results):
    packed(results)
    first = Path("out/study.zip").read_bytes()
    for file in results.rglob("*.*"):
        os.utime(file, (0, 1_000_000_000))
    packed(results)
    assert Path("out/study.zip").read_bytes() == first


def test_metadata_for_archives_agree():
    cff = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    zenodo = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    assert cff["version"] == gstlib.__version__
    assert zenodo["title"] == cff["title"]
    assert zenodo["license"] == cff["license"]
