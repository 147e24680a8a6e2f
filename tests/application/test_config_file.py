"""A config file that cannot be read is refused in one sentence, with the line and the remedy."""

import pytest
from gst.config_file import read_config_file
from gstlib.errors import ConfigError


def test_what_stands_in_it(tmp_path):
    path = tmp_path / "Fläche 1.yaml"
    path.write_text("title: Fläche\nsquare: {size_mm: 5}\n", encoding="utf-8")
    assert read_config_file(path) == {"title": "Fläche", "square": {"size_mm": 5}}


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"# a stone\ntitle: my: stone\n", "line 2, column 10: title: my: stone"),
        (b"square:\n\tsize_mm: 5\n", "line 2"),
        (b'title: "\x07"\n', "#x0007"),
        (b"# a stone\ntitle: Fl\xe4che\n", "byte 0xe4"),
        (b"- a\n- b\n", "holds ['a', 'b'], not keys"),
        (b"# nothing\n", "holds None"),
    ],
)
def test_what_is_no_config(tmp_path, content, problem):
    path = tmp_path / "mine.yaml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"mine\.yaml: ") as caught:
        read_config_file(path)
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


def test_no_such_file(tmp_path):
    for path in (tmp_path / "mine.yaml", tmp_path):
        with pytest.raises(ConfigError, match=f"{path.name}: cannot be opened.*path"):
            read_config_file(path)
