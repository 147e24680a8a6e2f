"""Edits of configs and tables change the values that are meant, and no other byte."""

import copy
import json

import pytest
from gst.config.edited import save_text, text_of, with_cells, with_values
from gst.config.strict_yaml import parse_yaml
from gst.config.user_tables import records_of
from gstlib.errors import ConfigError
from hypothesis import given
from hypothesis import strategies as st

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
    st.none() | st.booleans() | st.integers() | st.text("TODO:,# '\"[{&*!%-|é\n1", max_size=5),
    st.floats(-1e15, 1e15),
    st.sampled_from(["no", "0550", "9:10", "1e3", "2024-01-01", "null", "~", "=", "<<", "x" * 300]),
    st.sampled_from([[], {}, [[1, 2.5], [3, 4]], {"a": [None, "b, c"], "d": {}}]),
)


def keys_of(section, before=()):
    """All keys of a section, and one more in each section."""
    yield (*before, "new")
    for name, value in section.items():
        yield (*before, name)
        if isinstance(value, dict) or value is None:
            yield from keys_of(value or {}, (*before, name))


@given(
    st.permutations(PARTS),
    st.integers(0, len(PARTS) - 1),
    st.sampled_from(["", "# head\n\n", "---\n", "\ufeff"]),
    st.sampled_from(["\n", "\r\n", "\r"]),
    VALUES,
    st.data(),
)
def test_an_edited_config_differs_only_in_the_value(parts, n, head, line_end, value, data):
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
        ("load:\nnext: 1", {"load.force_N": 200.0}, "load: {force_N: 200.0}\nnext: 1"),
        ("load:   # c\n", {"load.force_N": 2}, "load: {force_N: 2}   # c\n"),
        ("a:\n  - 1  # one\n  - 2  # two\n", {"a": [1, 3]}, "a:\n  - 1  # one\n  - 3  # two\n"),
        ("a:  # l\n- 1\n- 2  # two\n\nb: 1\n", {"a": "TODO"}, "a: TODO  # l  # two\n\nb: 1\n"),
        ("a:\n    b: 1\n  # c\n\nd: 2\n", {"a.e": 3}, "a:\n    b: 1\n    e: 3\n  # c\n\nd: 2\n"),
        ("a: {b: 1,  # c\n}\n", {"a.d": 2}, "a: {b: 1, d: 2,  # c\n}\n"),
        ("a: 1\r\nb: 2", {"c": 3}, "a: 1\r\nb: 2\r\nc: 3"),
        ("a: 1.50  # as it was\n", {"a": 1.5}, "a: 1.50  # as it was\n"),
        ("a: |\n  text\n\nb: 1\n", {"a": "x", "c": 1}, "a: x\n\nb: 1\nc: 1\n"),
    ],
)
def test_where_a_value_is_written(text, values, edited):
    assert with_values(text, values) == edited


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("load: 5\n", "load.force_N"),  # which would be lost
        ("# nothing\n", "a"),
        ("a: &x {b: 1}\nc: *x\n", "c.b"),
        ("a: |+\n  text\n\n", "c"),  # the blank line is a part of the text
        ("a: [1\n", "a"),
    ],
)
def test_a_config_that_cannot_take_a_value_is_refused(text, key):
    with pytest.raises(ConfigError):
        with_values(text, {key: 2})


CELLS = st.sampled_from(
    [
        "",
        "1,50",
        "0",
        "a; b",
        'a "b"',
        "left\nside",
        "left\r\n# side",
        "\n\n",
        "é☃",
        "TODO",
        " pad ",
    ]
)
BETWEEN = st.sampled_from(["", "# 5\" ; 'wide'", '"# quoted";;', ";;", "  # c"])


@given(
    st.lists(st.tuples(CELLS, CELLS, st.booleans(), st.none() | BETWEEN), min_size=1, max_size=4),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.sampled_from(["", "\ufeff"]),
    st.booleans(),
    st.dictionaries(st.sampled_from(["x_mm", "note", "new"]), CELLS.map(str.strip), max_size=2),
    st.data(),
)
def test_an_edited_table_differs_only_in_the_cells(rows, line_end, mark, is_ended, cells, data):
    def written(cell, is_quoted):
        needs = is_quoted or any(sign in cell for sign in ';"\r\n')
        return '"{}"'.format(cell.replace('"', '""')) if needs else cell

    lines = ["# places", "patch; X_mm;note;;"]
    for n, (x, note, is_quoted, between) in enumerate(rows):
        lines.append(";".join(written(cell, is_quoted) for cell in (f"p{n}", x, note, "", "")))
        lines += [between] * (between is not None)
    lines[-1] += line_end * is_ended
    text = mark + line_end.join(lines)
    n = data.draw(st.integers(0, len(rows) - 1))
    edited = with_cells(text, lambda row: cells if row["patch"] == f"p{n}" else {})
    records, _ = records_of(edited.removeprefix("\ufeff"))
    header, *others = [record.cells for record in records if record.is_row]
    assert header == ["patch", "X_mm", "note", "new" if "new" in cells else "", ""]
    for number, (row, (x, note, *_)) in enumerate(zip(others, rows, strict=True)):
        expected = {"patch": f"p{number}", "x_mm": x.strip(), "note": note.strip(), "new": ""}
        expected |= cells if number == n else {}
        assert row == [*expected.values(), ""]
    if "new" not in cells:
        start = text.index(f"p{n}")
        end = text.find(f"p{n + 1}") if n + 1 < len(rows) else len(text)
        assert edited.startswith(text[:start])
        assert edited.endswith(text[end:])


@pytest.mark.parametrize(
    ("table", "cells", "edited"),
    [
        ("Patch; X_mm\n1; 2\n", {"x_mm": "1"}, "Patch; X_mm\n1;1\n"),
        ("patch,note\n1,a\n2,b\n", {"note": "a"}, "patch,note\n1,a\n2,b\n"),
        ('"patch";"t0"\n"1";"a"\n', {"t0": "b"}, '"patch";"t0"\n"1";"b"\n'),
        # numbers have the decimal sign of the table; an equal number stays as it is written
        ("patch\tx_mm\ty_mm\n1\t1,50\t2\n", {"x_mm": "1.5", "y_mm": "0.5"}, None),
        ("# nothing\n", {"a": 1}, "# nothing\n"),
    ],
)
def test_how_a_cell_is_written(table, cells, edited):
    edited = edited or "patch\tx_mm\ty_mm\n1\t1,50\t0,5\n"
    assert with_cells(table, lambda row: cells if row["patch"] == "1" else {}) == edited


def test_rows_go_and_come():
    table = "patch,x_mm,\r\n1,2,\r\n2,3,"
    new = {"patch": "3", "y_mm": "a,b"}
    edited = with_cells(table, lambda row: None if row["patch"] == "1" else {}, [new])
    assert edited == 'patch,x_mm,y_mm\r\n2,3,\r\n3,,"a,b"'


@pytest.mark.parametrize("header", ["patch;note;Note", "place;patch;x_mm;X_mm "])
def test_two_columns_of_one_name_are_refused(header):
    with pytest.raises(ConfigError, match="two columns"):
        with_cells(f"{header}\n1;2;3;4\n", lambda _: {"x_mm": 1}, renamed={"place": "patch"})


def test_a_quote_that_is_not_closed_is_refused():
    with pytest.raises(ConfigError, match="quotes"):
        with_cells('patch;x_mm\n1;"2\n', lambda _: {"x_mm": 1})


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-be", "cp1252"])
def test_a_file_keeps_its_encoding(tmp_path, encoding):
    path, mark = tmp_path / "a.csv", "\ufeff" * (encoding == "utf-16-be")
    path.write_bytes(f"{mark}patch;t0\r\n1;Mühle\r\n".encode(encoding))
    save_text(path, with_cells(text_of(path), lambda _: {"t0": "Öse"}))
    assert path.read_bytes() == f"{mark}patch;t0\r\n1;Öse\r\n".encode(encoding)


def test_a_character_that_a_file_cannot_have_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes("ü".encode("cp1252"))
    with pytest.raises(ConfigError, match="Save it in UTF-8"):
        save_text(path, "☃")
    path.write_bytes(b"PK\x03\x04\0")
    with pytest.raises(ConfigError, match="not text"):
        text_of(path)
