"""Scripts refuse what they cannot use."""

import importlib.util
from pathlib import Path

import pytest
from gstlib.errors import ConfigError, InputError

WORKFLOW = Path(__file__).parents[2] / "workflow"


def script_of(rule):
    path = WORKFLOW / f"scripts/{rule}.py"
    spec = importlib.util.spec_from_file_location("script", path)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script


def test_a_ceiling_below_a_pressure_is_refused_before_anything_is_solved(tmp_path):
    script = script_of("solve_cases")
    pressures = tmp_path / "pressures.csv"
    columns = "patch,x_mm,y_mm,rotation_deg,pressure_MPa,square_pressure_MPa,in_study"
    pressures.write_text(f"{columns}\n3,1,1,0,12,9,yes\n5,2,1,0,50,9,no\n7,3,1,0,40,9,yes\n")
    for hardness, error in ((40.0, ConfigError), (40.1, InputError)):
        with pytest.raises(error) as raised:
            script.main(
                tmp_path / "square.h5",
                [tmp_path / f"{patch}.h5" for patch in "357"],  # there are none
                pressures,
                tmp_path / "table.csv",
                patches=["3", "5", "7"],
                patch_mm=0.85,
                other_modulus_MPa=None,
                grinding=None,
                hardness_MPa=hardness,
            )
        assert ("of patch 7 (40 MPa)." in str(raised.value)) == (hardness == 40.0)
        assert ("3.h5" in str(raised.value)) == (hardness == 40.1)  # the first to be read


def test_published_values_of_patches_whatever_their_names(tmp_path):
    path, pressures, published = (tmp_path / name for name in ("path", "pressures", "published"))
    path.write_text("displacement_um,mean_pressure_MPa,contact_fraction\n9,22,0.1\n")
    columns = "patch,x_mm,y_mm,rotation_deg,pressure_MPa,square_pressure_MPa"
    pressures.write_text(f"{columns}\nNA,1,1,0,12,9\n007,2,1,0,13,9\n")
    published.write_text(
        "quantity,patch,unit,value\n# of the paper\npatch pressure,NA,MPa,11\n"
        "patch pressure,007,MPa,\nmean pressure,,MPa,21\n"
    )
    script_of("compare_published").main(published, path, pressures, tmp_path / "table.csv")
    rows = (tmp_path / "table.csv").read_text().splitlines()[1:]
    assert [row.split(",")[1:] for row in rows] == [
        ["NA", "MPa", "11", "12"],
        ["007", "MPa", "", "13"],
        ["", "MPa", "21", "22"],
    ]


def test_cases_and_what_they_tell_are_named_in_their_caption():
    text = (WORKFLOW / "report/tables/cases.rst").read_text(encoding="utf-8")
    said = "study", "other modulus", "grinding", "slip share", "mean traction"
    said += "tangential displacement", "ceiling", "share at the ceiling", "iou", "deepest yield"
    assert [name for name in said if f"``{name}``" not in " ".join(text.split())] == []
