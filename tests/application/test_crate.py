"""`gst package`: what is in the zip, what it says of it, and what is refused."""

import contextlib
import hashlib
import json
import os
import shutil
import tempfile
import zipfile
from pathlib import Path
from urllib.parse import unquote

import gstlib
import pytest
import yaml
from click.testing import CliRunner
from gst.cli import main
from gst.run.chain import given_to, step_of, write_record
from gst.run.provenance import program_hash
from gst.share.crate import pack_study
from gstlib.errors import InputError
from gstlib.io.files import sha256
from hypothesis import example, given, settings
from hypothesis import strategies as st

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
    return study_in(tmp_path)


def study_in(working):
    """The results of a finished study in a working folder."""
    folder = working / "out/results"
    write(folder, RESULTS | LEFT_OUT)
    write(working, {name: content for name, content in INPUTS.items() if content})
    said = {"category": "5 Validation", "caption": "<p>Loss &amp;\n<em>pressure</em>.</p>"}
    contents = [
        said | {"file": name, "title": f"title of {name}", "sha256": sha256(folder / name)}
        for name in RESULTS
    ]
    (folder / "contents.json").write_text(json.dumps(contents))
    record(folder)
    return folder


def packed(results, **options):
    """The files of the zip, the whole as the metadata describe it, and the other entities."""
    target = results.parent / "study.zip"
    count = pack_study(results, target, **options)
    with zipfile.ZipFile(target) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    assert count == len(files)
    entities = json.loads(files["ro-crate-metadata.json"])["@graph"]
    by_id = {unquote(entity["@id"]): entity for entity in entities}
    assert len(by_id) == len(entities)
    return files, by_id.pop("./"), by_id


def test_what_is_packed_and_described(results):
    files, whole, entities = packed(results)
    patches, _, _, *others = INPUTS
    names = {f"results/{name}" for name in (*RESULTS, "contents.json", "provenance.json")}
    names |= {patches, *others, "config/study.yaml", "README.md"}
    assert {unquote(part["@id"]) for part in whole["hasPart"]} == names
    for name in names:
        assert entities[name]["sha256"] == hashlib.sha256(files[name]).hexdigest()
        assert entities[name]["contentSize"] == str(len(files[name]))
    assert entities["results/tables/wear.csv"]["name"] == "Validation: title of tables/wear.csv"
    assert {name: files[name] for name in (patches, *others)} == {
        name: INPUTS[name] for name in (patches, *others)
    }
    assert {"Snakefile", "workflow/rules/common.smk", f"results/{PAGE_RECORD}"} <= files.keys()
    assert not any(name.endswith((".h5", "old.csv", "check.png", ".plu")) for name in files)
    provenance = json.loads(files["results/provenance.json"])
    assert provenance["inputs"].keys() == INPUTS.keys()
    assert yaml.safe_load(files["config/study.yaml"]) == provenance["config"]


def test_a_generated_specimen_cannot_pass_for_a_real_tool(results):
    files, whole, _ = packed(results)
    assert "generated" not in json.dumps(whole) + files["README.md"].decode()
    record(results, specimen={"seed": 7})
    files, whole, _ = packed(results)
    assert "synthetic specimen" in whole["name"]
    assert "synthetic specimen" in whole["keywords"]
    for text in (whole["description"], files["README.md"].decode()):
        assert "says anything about a real tool" in text


def test_date_authors_and_licence(results):
    for number, file in enumerate(sorted(results.rglob("*.*"))):
        os.utime(file, (0, 1_000_000_000 + number % 3))
    _, whole, _ = packed(results)
    assert whole["datePublished"] == "2001-09-09"
    assert "author" not in whole
    assert "None is stated" in whole["license"]
    _, whole, entities = packed(results, authors=["Ada Lovelace"], licence="CC-BY-4.0")
    assert whole["author"] == [{"@id": entities["#Ada Lovelace"]["@id"]}]
    assert whole["license"].endswith("/CC-BY-4.0")


def list_in_contents(name):
    """As somebody else might: the records fit each other."""
    contents = Path("out/results/contents.json")
    contents.write_text(contents.read_text().replace("tables/wear.csv", name))
    record(Path("out/results"))


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
    "contents from elsewhere": (
        lambda: list_in_contents("../../private"),
        "outside the results: ../../private",
    ),
    "contents twice": (
        lambda: list_in_contents("figures/wear.png"),
        "names it twice: figures/wear.png",
    ),
    "contents of no step": (lambda: list_in_contents("tables/old.csv"), "tables/old.csv"),
    "private table": (lambda: name_table("/etc/passwd"), "/etc/passwd"),
    "private table by a link": (link_table, "link.tsv"),
    "table of another digest": (lambda: name_table("data/a.plu", "00"), "a.plu"),
    "elsewhere": (lambda: os.chdir("/"), "patches ü.tsv: this table of the study is missing"),
}


@pytest.mark.parametrize(("damage", "problem"), DAMAGED.values(), ids=DAMAGED)
def test_what_is_no_finished_study_is_refused(results, tmp_path, damage, problem):
    damage()
    with pytest.raises(InputError, match=problem):
        pack_study(results, tmp_path / "study.zip")
    assert not (tmp_path / "study.zip").exists()


HOSTILE = ["provenance.json", "contents.json", PAGE_RECORD, "index.html", "tables", "export", "."]
HOSTILE += ["tables/wear.csv", "tables/more.csv", "export/tool.ply", "../../config/published.csv"]
HOSTILE += ["../../packed.zip"]
SPOIL = {
    "link": lambda file, private: file.symlink_to(private / "key"),
    "link to a folder": lambda file, private: file.symlink_to(private),
    "loop": lambda file, _: file.symlink_to(file.name),
    "pipe": lambda file, _: os.mkfifo(file),
    "folder": lambda file, _: file.mkdir(),
    "of somebody else": lambda file, _: file.write_bytes(b"patch\n7\n"),
    "missing": lambda *_: None,
}
DEEP = b"[" * 100_000 + b"]" * 100_000
VALUES = st.none() | st.booleans() | st.integers() | st.floats() | st.text()
VALUES |= st.sampled_from(["a\0b", "../../private/key", "/etc/passwd", "x" * 300, "\ud800", "."])
VALUES = st.recursive(VALUES, lambda part: st.lists(part) | st.dictionaries(st.text(), part))


def spoil_file(results, private, name, how):
    file = results / name
    if file.is_dir():
        shutil.rmtree(file)
    file.unlink(missing_ok=True)
    file.parent.mkdir(exist_ok=True)
    SPOIL[how](file, private)


def spoil_json(name, keys, value):
    """Put a value at keys of a JSON file, as far as it has them; or bytes in its place."""

    def change(content):
        part, last = content, None
        for key in keys:
            inside = [*part] if isinstance(part, dict) else [*range(len(part))]
            last = part, inside[key % len(inside)]
            if not isinstance(part := last[0][last[1]], dict | list) or not part:
                break
        last[0][last[1]] = value
        return json.dumps(content).encode()

    edit_record(name, (lambda _: value) if isinstance(value, bytes) else change)


def snapshot(folder):
    """What every file in a folder is, without following a link or reading a pipe."""
    return {
        file: file.read_bytes()
        if file.is_file() and not file.is_symlink()
        else (file.lstat().st_mode, file.is_symlink() and os.readlink(file))
        for file in folder.rglob("*")
    }


def run_all(working, spoil):
    """Every command that takes results: none ends otherwise than documented or does harm."""
    private, study = working / "private", working / "study"
    write(private, {"key": b"SECRET"})
    study_in(study)
    with contextlib.chdir(study):
        spoil(Path("out/results"), private)
        before = snapshot(working)
        for command in (
            ["package", "out/results", "--output", "packed.zip"],
            ["export", "out/results"],
            ["diff", "out/results", "out/results"],
        ):
            result = CliRunner().invoke(main, command)
            assert isinstance(result.exception, SystemExit | None), command
            assert result.exit_code in (0, 2), command
            assert "SECRET" not in result.output
        after = snapshot(working)
    assert {file: after[file] for file in before} == before
    packed = study / "packed.zip"
    assert after.keys() - before.keys() <= {packed}
    if packed in after and packed not in before:
        with zipfile.ZipFile(packed) as archive:
            assert not any(b"SECRET" in archive.read(name) for name in archive.namelist())


@pytest.mark.parametrize("how", SPOIL)
@pytest.mark.parametrize("name", HOSTILE)
def test_no_hostile_file_is_read_replaced_or_waited_for(tmp_path, name, how):
    run_all(tmp_path, lambda results, private: spoil_file(results, private, name, how))


@given(
    name=st.sampled_from(["provenance.json", "contents.json", PAGE_RECORD]),
    keys=st.lists(st.integers(0, 9), min_size=1, max_size=4),
    value=VALUES,
)
@example(name="provenance.json", keys=[0], value=DEEP)
@example(name="provenance.json", keys=[0], value=b"[]")
@example(name="provenance.json", keys=[0], value=b"[1, 2]")
@example(name="provenance.json", keys=[0], value=b"\xff\xfe{")
@example(name="contents.json", keys=[0], value=DEEP)
@example(name="contents.json", keys=[0], value=b"7")
@example(name=PAGE_RECORD, keys=[0], value=DEEP)
@example(name=PAGE_RECORD, keys=[3], value={})  # params without steps
@settings(max_examples=40, deadline=None)
def test_whatever_json_is_in_results_is_refused_in_a_sentence(name, keys, value):
    with tempfile.TemporaryDirectory() as folder:
        run_all(Path(folder), lambda *_: spoil_json(name, keys, value))


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
