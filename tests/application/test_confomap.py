"""ConfoMap's results beside the study's: the same numbers agree, whatever their units."""

import pytest
from click.testing import CliRunner
from gst.cli import main
from gst.confomap import compare_texture

# As ConfoMap writes them: a column of text among the parameters, two frames, a comma at the end.
HEADER = (
    "#,#,#,1,1,5,5,5,5,5,5,\n"
    "#,#,#,Name,NM-points ratio - Z,Sq,Root-mean-square height (Sq),Ssk,Sdr,Vmp,Smr,\n"
    "#,#,#,<no unit>,%,nm,µm,<no unit>,%,µm³/µm²,%,\n"
)
LINE = "2021/01/25,15:35:36,D:\\r\\{name}.mnt,{name} > Leveled (LS-plane),0,{results},1\n"
TEXTURE = """patch,epoch,size_x_mm,Sq_um,Ssk,Sdr_percent,Vmp_um3_per_um2
loc1,T0,0.8,1.25,0.5,2,0.04
loc1,T1,0.8,1,0,2,0.05
loc1,change,,-0.25,-0.5,0,0.01
"""
INPUTS = "patch,epoch,file\nloc1,T0,a_loc1_0strokes.sur\nloc1,T1,a_loc1_2000strokes.sur\n"


@pytest.fixture
def results(tmp_path):
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables/texture.csv").write_text(TEXTURE)
    (tmp_path / "tables/inputs.csv").write_text(INPUTS)
    return tmp_path


def write(folder, *lines, header=HEADER, encoding="cp1252"):
    text = header + "".join(LINE.format(name=name, results=cells) for name, cells in lines)
    (folder / "confomap.csv").write_text(text, encoding=encoding)
    return folder / "confomap.csv"


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8"])
def test_each_parameter_stands_beside_its_own_in_our_unit(results, encoding):
    first = ("a_loc1_0strokes", "1375,1.25,0.5,2.1,*****")
    other = ("17a_loc1_0strokes", "9,9,9,9,9")
    second = ("a_loc1_2000strokes", "1000,1,0.1,2,0.05")
    found = compare_texture(results, write(results, first, other, second, encoding=encoding))
    assert list(found.parameter) == 2 * ["Sq", "Sq", "Ssk", "Sdr", "Vmp"]
    assert list(found.epoch) == 5 * ["T0"] + 5 * ["T1"]
    assert list(found.unit[:5]) == ["µm", "µm", "", "%", "µm³/µm²"]
    assert list(found.confomap[:4]) == pytest.approx([1.375, 1.25, 0.5, 2.1])
    assert list(found.difference_percent[:4]) == pytest.approx([10, 0, 0, 5], abs=1e-9)
    assert found[["confomap", "difference_percent"]].iloc[4].isna().all()
    assert found.difference_percent[5:].isna().tolist() == [False, False, True, False, False]


def test_the_command_prints_them_or_says_what_it_cannot_use(results):
    scan, values = "a_loc1_0strokes", "1375,1.25,0.5,2.1,*****"
    for line, header, said in (
        ((scan, values), HEADER, "loc1 T0 Sq µm 5 1.25 1.375 10"),
        ((scan, values), "Sq,Ssk\n", "do not begin with '#'"),
        ((scan, values), HEADER.replace(",nm,", ",inch,"), "Sq is in 'inch'"),
        (("another", values), HEADER, "none of its 1 lines names a scan"),
        ((scan, "1,2,ERR,4,5"), HEADER, "Ssk is 'ERR', not a number"),
    ):
        file = write(results, line, header=header)
        result = CliRunner().invoke(main, ["compare-texture", str(results), str(file)])
        assert said in " ".join(result.output.split())
        assert (result.exit_code == 0) == (said.startswith("loc1"))
