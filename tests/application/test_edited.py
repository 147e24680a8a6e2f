"""Edits of configs and tables change the values that are meant, and no other byte."""

import copy
import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gst.config.edited import save_text, text_of, with_cells, with_values
from gst.config.strict_yaml import parse_yaml
from gst.config.user_tables import records_of
from gstlib.errors import ConfigError

# Parts of a config, as people write them, each with its own keys.
PARTS = [
    "title: 'it''s'  # mine\n",
    "load:  # to come\n",
    "material:\n\n# of both stones\n",
    "scans:  # of moulds\n    size_mm:   0.850   # side\n    mould: { invert: true, flip : y }\n"
    "    # last\n\n",
    "square:\n  points_mm:   # corners\n  - [1, 2.50]   # a\n  - - 3\n    - 4  # b\n",
    "note: |\n  # no comment\n  text\n\n",
    "text: words\n  that go on  # with\ta tab\n",
    "'quoted': &anchor {a: [1,\n   2], # é☃\n  \"b\": , c: ~}  # 𝄞\n",
    "none: {}\nlist: [ ]\nkept : null\n",
    "deep:\n   er:\n       est: 1e-3\n       last:\n",
]
VALUES = st.one_of(
    st.none()
    | st.booleans()
    | st.integers()
    | st.text("TODO:,# '\"[{&*!%-|é\n1", max_size=5),
    st.floats(-1e15, 1e15),
    st.sampled_from(["no", "0550", "9:10", "2024-01-01", "null", "=", "<<", "x" * 300]),
    st.sampled_from([[], {}, [[1, 2.5], [3, 4]], {"a": [None, "b, c"], "d": {}}]),
)


def keys_of(section, before=()):
    """All keys of a section, and one more in each section."""
    yield (*before, "new")
    for name, value in section.items():
        yield (*before, name)
        if isinstance(value, dict) or value is None:
            yield from keys_of(value or {}, (*before, name))


@settings(deadline=None)  # a busy machine is no fault
@given(
    st.permutations(PARTS),
    st.integers(0, len(PARTS) - 1),
    st.sampled_from(["", "# head\n\n", "---\n", "\ufeff"]),
    st.sampled_from(["\n", "\r\n", "\r"]),
    VALUES,
    st.data(),
)
def test_an_edited_config_differs_only_in_the_value(
    parts, n, head, line_end, value, data
):
    head, *parts = [part.replace("\n", line_end) for part in (head, *parts)]
    keys = data.draw(st.sampled_from([*keys_of(parse_yaml(parts[n], "part"))][1:]))
    expected = parse_yaml(head + "".join(parts), "whole")
    section = expected
    for name in keys[:-1]:
        section[name] = section[name] if section[name] is not None else {}
        section = section[name]
    section[keys[-1]] = copy.deepcopy(value)
    edited = with_values(head + "".join(parts), {".".join(keys): value})
    assert json.dumps(parse_yaml(edited, "edited")) == json.dumps(expected)
    assert edited.startswith(head + "".join(parts[:n]))
    assert edited.endswith("".join(parts[n + 1 :]))


@pytest.mark.parametrize(
    ("text", "values", "edited"),
    [
        ("a:\n  - 1  # one\n  - 2  # two\n", {"a": [1, 3]}, "a: [1, 3]  # two\n"),
        (
            "a:  # l\n- 1\n- 2  # two\n\nb: 1\n",
            {"a": "TODO"},
            "a: TODO  # l  # two\n\nb: 1\n",
        ),
        ("a: 1.50  # as it was\n", {"a": 1.5}, "a: 1.50  # as it was\n"),
    ],
)
def test_where_a_value_is_written(text, values, edited):
    assert with_values(text, values) == edited


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("load: 5\n", "load.force_N"),  # which would be lost
        ("a: &x {b: 1}\nc: *x\n", "c.b"),
        ("a: |+\n  text\n\n", "c"),  # the blank line is a part of the text
    ],
)
def test_a_config_that_cannot_take_a_value_is_refused(text, key):
    with pytest.raises(ConfigError):
        with_values(text, {key: 2})


def rows_of(text):
    """The cells of a table, without its comments."""
    records, _ = records_of(text.removeprefix("\ufeff"))
    return [record.cells for record in records if record.is_row]


CELLS = [
    "",
    "1,50",
    '"a; b"',
    '"a ""b"""',
    '"left\nside"',
    '"left\r\n# side"',
    '"\n\n"',
    " pad ",
]
BETWEEN = ["", "# 5\" ; 'wide'\n", '"# quoted";;\n', ";;\n", "\n"]


@settings(deadline=None)
@given(
    st.lists(st.sampled_from(CELLS), min_size=3, max_size=3),
    st.sampled_from(BETWEEN),
    st.sampled_from(["", "\ufeff# places\r\n"]),
    st.sampled_from(["x_mm", "note"]),
    st.sampled_from(["", "1,50", "a; b", 'a "b"', "left\nside", "é☃"]),
)
def test_an_edited_table_differs_only_in_the_cell(notes, between, head, name, cell):
    rows = [f"p{number}; 2 ;{note};;" for number, note in enumerate(notes)]
    start = f"{head}patch; X_mm;note;;\n{rows[0]}\n{between}"
    text = f"{start}{rows[1]}\n{rows[2]}"
    edited = with_cells(text, lambda row: {name: cell} if row["patch"] == "p1" else {})
    assert edited.startswith(start)
    assert edited.endswith(f"\n{rows[2]}")
    before, after = map(rows_of, (text, edited))
    before[2][1 if name == "x_mm" else 2] = cell
    assert after == before


def test_a_cell_keeps_the_quotes_of_its_table():
    edited = with_cells('"patch";"t0"\n"1";"a"\n', lambda _: {"t0": "b"})
    assert edited == '"patch";"t0"\n"1";"b"\n'


def test_rows_go_and_come():
    table = "patch,x_mm,\r\n1,2,\r\n2,3,"
    new = {"patch": "3", "y_mm": "a,b"}
    edited = with_cells(table, lambda row: None if row["patch"] == "1" else {}, [new])
    assert edited == 'patch,x_mm,y_mm\r\n2,3,\r\n3,,"a,b"'


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("patch;note;Note\n1;2;3\n", "two columns"),
        ("place;x_mm; X_mm\n1;2;3\n", "two columns"),
        ('patch;x_mm\n1;"2\n', "quotes"),
    ],
)
def test_a_table_that_cannot_take_a_cell_is_refused(table, words):
    with pytest.raises(ConfigError, match=words):
        with_cells(table, lambda _: {"x_mm": 1})


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_a_file_keeps_its_encoding(tmp_path, encoding):
    path = tmp_path / "a.csv"
    path.write_bytes("patch;t0\r\n1;Mühle\r\n".encode(encoding))
    save_text(path, with_cells(text_of(path), lambda _: {"t0": "Öse"}))
    assert path.read_bytes() == "patch;t0\r\n1;Öse\r\n".encode(encoding)
    if encoding == "cp1252":
        with pytest.raises(ConfigError, match="Save it in UTF-8"):
            save_text(path, "☃")
    path.write_bytes(b"PK\x03\x04\0")
    with pytest.raises(ConfigError, match="not text"):
        text_of(path)
