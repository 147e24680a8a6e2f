import hashlib
import json
import shutil
from pathlib import Path

import gstlib
from gstlib.provenance import file_sha256, provenance, source_hash


def test_hash_is_that_of_the_bytes(tmp_path):
    (tmp_path / "a").write_bytes(b"stone")
    assert file_sha256(tmp_path / "a") == hashlib.sha256(b"stone").hexdigest()


def test_provenance_does_not_depend_on_folder_or_order(tmp_path):
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        for name in "ab":
            (tmp_path / folder / name).write_text(name)
    one = provenance([tmp_path / "one/a", tmp_path / "one/b"], {"x": 1, "y": [2]})
    two = provenance([tmp_path / "two/b", tmp_path / "two/a"], {"y": [2], "x": 1})
    assert one == two
    assert json.loads(one["settings"]) == {"x": 1, "y": [2]}
    assert one["gstlib_version"] == gstlib.__version__


def test_source_hash_follows_imports_only(tmp_path, monkeypatch):
    package = tmp_path / "gstlib"
    shutil.copytree(Path(gstlib.__file__).parent, package)
    monkeypatch.setattr(gstlib, "__file__", str(package / "__init__.py"))
    script = tmp_path / "script.py"
    script.write_text("from gstlib.io.store import read_dataset\n")

    def hash_after_change(name):
        with (package / name).open("a") as file:
            file.write("\n# changed\n")
        return source_hash(script)

    before = source_hash(script)
    assert hash_after_change("coupling.py") == before
    direct = hash_after_change("io/store.py")
    assert direct != before
    assert hash_after_change("errors.py") != direct  # imported by store

    script.write_text("from gstlib.bem import solve_contact\n")
    before = source_hash(script)
    assert hash_after_change("bem/halfspace.py") != before  # a relative import, two steps away
