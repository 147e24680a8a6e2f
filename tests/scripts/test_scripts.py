"""Scripts refuse what they cannot use, and pass on what is doubtful."""

import re
import runpy
from pathlib import Path

import numpy as np
import xarray as xr

from gstlib.io.store import write_dataset
from gstlib.surfaces.grid import make_surface

WORKFLOW = Path(__file__).parents[2] / "workflow"


def main_of(rule):
    return runpy.run_path(str(WORKFLOW / f"scripts/{rule}.py"))["main"]


def test_a_changed_program_is_a_reason_to_run_every_script_again():
    """By the param `code`, which the pictures have from `DRAWN`."""
    page = (WORKFLOW / "rules/page.smk").read_text("utf-8")
    assert re.search(
        r'^DRAWN = \{[^}]*"code": code\("draw_figures.py"\)', page, re.MULTILINE
    )
    scripts = set()
    for file in WORKFLOW.glob("rules/*.smk"):
        for rule in re.split(r"^ *rule ", file.read_text("utf-8"), flags=re.MULTILINE):
            for script in re.findall(r'script:\s*"\.\./scripts/(\w+\.py)"', rule):
                is_drawn = script == "draw_figures.py"
                param = "**DRAWN" if is_drawn else f'code=code("{script}")'
                assert param in rule, rule
                scripts.add(script)
    assert {path.name for path in WORKFLOW.glob("scripts/*.py")} == scripts


def test_published_values_of_patches_whatever_their_names(tmp_path):
    path, pressures, published = [
        tmp_path / name for name in ("path", "bear", "published")
    ]
    path.write_text("displacement_um,mean_pressure_MPa,contact_fraction\n9,22,0.1\n")
    columns = "patch,x_mm,y_mm,rotation_deg,pressure_MPa,square_pressure_MPa"
    pressures.write_text(f"{columns}\nNA,1,1,0,12,9\n007,2,1,0,13,9\n")
    rows = "patch pressure,NA,,11\npatch pressure,007,MPa,\nmean pressure,,MPa,21\n"
    published.write_text(f"quantity,patch,unit,value\n{rows}")
    arguments = published, path, pressures, tmp_path / "published.csv"
    main_of("compare_published")(*arguments)
    rows = arguments[-1].read_text().splitlines()[1:]
    assert [row.partition(",")[2] for row in rows] == [
        "NA,MPa,11,12",
        "007,MPa,,13",
        ",MPa,21,22",
    ]


def test_a_doubtful_contact_of_the_stone_is_told(tmp_path, caplog):
    """A flat stone on a flat is pressed at its edges."""
    height = make_surface(np.zeros((20, 20)), 0.25)
    face = xr.Dataset({"height": height, "counterface": height, "size_mm": 5.0})
    for variable in face.values():
        variable.attrs.update(units="mm", long_name="height")
    write_dataset(tmp_path / "face.h5", face)
    face, *written = (
        tmp_path / name for name in ("face.h5", "contact.h5", "macroscale_path.csv")
    )
    settings = {"load_point": (2.5, 2.5), "modulus": 1e4, "patch_mm": 0.85}
    settings["solving"] = {
        "steps": 2,
        "tolerance": 1e-6,
        "maximum_displacement_um": 100.0,
    }
    main_of("solve_macroscale")(face, [], *written, force_N=500.0, **settings)
    assert any("from the edge of the face" in message for message in caplog.messages)
