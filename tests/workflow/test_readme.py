"""The README's example runs as it stands, on the files of a study."""

import re

from conftest import ROOT


def test_example_of_the_readme(finished_tiny, monkeypatch, capsys):
    (example,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    (file,) = re.findall(r'read_scan\("results/(.*?)"\)', example)
    assert (finished_tiny.results / file).is_file()
    monkeypatch.chdir(finished_tiny.folder)
    exec(example.replace("results/", f"{finished_tiny.results.name}/"), {})
    contact_fraction, highest = map(float, capsys.readouterr().out.split())
    assert 0 < contact_fraction < 1
    assert highest > 22
