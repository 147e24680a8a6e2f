"""Scripts refuse what they cannot use, and pass on what is doubtful."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.ndimage
import xarray as xr
from contacts import interface, mesh_face, rough
from gstlib.contact import Load, contact_at_pressure
from gstlib.coupling.intervals import Errors
from gstlib.errors import ConfigError
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_table
from gstlib.macroscale.gesture import Gesture, press_poses, stroke_poses
from gstlib.surfaces.grid import make_surface

WORKFLOW = Path(__file__).parents[2] / "workflow"


def script_of(rule):
    path = WORKFLOW / f"scripts/{rule}.py"
    spec = importlib.util.spec_from_file_location("script", path)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script


def test_a_changed_program_is_a_reason_to_run_every_script_again():
    """By the param `code`, which the pictures have from `DRAWN`."""
    drawn = {"draw_figures.py": r"\*\*DRAWN\b"}
    page = (WORKFLOW / "rules/page.smk").read_text(encoding="utf-8")
    assert re.search(r'^DRAWN = \{[^}]*"code": code\("draw_figures.py"\)', page, re.MULTILINE)
    told = []
    for file in sorted(WORKFLOW.glob("rules/*.smk")):
        for rule in re.split(r"^ *rule ", file.read_text(encoding="utf-8"), flags=re.MULTILINE):
            for script in re.findall(r'script:\s*"\.\./scripts/(\w+\.py)"', rule):
                param = drawn.get(script, rf'\bcode=code\("{re.escape(script)}"\)')
                assert re.search(param, rule), f"{file.name}: {rule.partition(':')[0]}"
                told.append(script)
    assert {path.name for path in WORKFLOW.glob("scripts/*.py")} == {*told}


def test_published_values_of_patches_whatever_their_names(tmp_path):
    path, pressures, published = (tmp_path / name for name in ("path", "pressures", "published"))
    path.write_text("displacement_um,mean_pressure_MPa,contact_fraction\n9,22,0.1\n")
    columns = "patch,x_mm,y_mm,rotation_deg,pressure_MPa,square_pressure_MPa"
    pressures.write_text(f"{columns}\nNA,1,1,0,12,9\n007,2,1,0,13,9\n")
    published.write_text(
        "quantity,patch,unit,value\n# of the paper\npatch pressure,NA,MPa,11\n"
        "patch pressure,007,MPa,\nmean pressure,,MPa,21\n"
    )
    script_of("compare_published").main(published, path, pressures, tmp_path / "published.csv")
    rows = (tmp_path / "published.csv").read_text().splitlines()[1:]
    assert [row.split(",")[1:] for row in rows] == [
        ["NA", "MPa", "11", "12"],
        ["007", "MPa", "", "13"],
        ["", "MPa", "21", "22"],
    ]
    published.write_text("quantity,patch,unit,value\npatch pressure,8,MPa,11\nforce,,MPa,1\n")
    with pytest.raises(ConfigError, match=r"\(patch 8\): the study has no") as said:
        script_of("compare_published").main(published, path, pressures, tmp_path / "published.csv")
    assert "'force' is not one of" in str(said.value)


def test_a_doubtful_contact_of_the_stone_is_told(tmp_path, caplog):
    """A flat stone on a flat is pressed at its edges."""
    height = make_surface(np.zeros((20, 20)), 0.25)
    face = xr.Dataset({"height": height, "counterface": height, "size_mm": 5.0})
    for variable in face.values():
        variable.attrs.update(units="mm", long_name="height")
    write_dataset(tmp_path / "face.h5", face)
    face, *written = (tmp_path / name for name in ("face.h5", "contact.h5", "macroscale_path.csv"))
    settings = {"load_point": (2.5, 2.5), "modulus": 1e4, "patch_mm": 0.85}
    settings["solving"] = {"steps": 2, "tolerance": 1e-6, "maximum_displacement_um": 100.0}
    script_of("solve_macroscale").main(face, [], *written, force_N=500.0, **settings)
    assert any("of the edge of what is pressed" in message for message in caplog.messages)


def test_a_form_taken_out_of_t1_is_warned_of_where_it_is_registered(tmp_path, caplog):
    rng = np.random.default_rng(1)
    x = np.tile(np.linspace(-1, 1, 64), (64, 1))
    texture = 1e-3 * scipy.ndimage.gaussian_filter(rng.standard_normal(x.shape), 1)
    bent = 3e-3 * x**2
    files = {"T0/A.h5": bent, "T0/B.h5": bent, "T1/A.h5": bent, "T1/B.h5": 0.0 * x}
    for file, form in files.items():
        height = make_surface(texture + form + 1e-5 * rng.standard_normal(x.shape), 1.66e-3)
        no = xr.zeros_like(height, dtype=bool).assign_attrs(units="1", long_name="none")
        scan = xr.Dataset({"height": height, "filled": no, "outlier": no})
        scan["height"].attrs.update(units="mm", long_name="height")
        write_dataset(tmp_path / file, scan)
    script_of("register_patches").main(
        [tmp_path / "T0"],
        [tmp_path / "T1"],
        [],
        tmp_path / "change",
        patches=["A", "B"],
        maximum_shift_mm=0.02,
        minimum_cluster_points=2,
    )
    (said,) = (message for message in caplog.messages if "long waves" in message)
    assert said.startswith("patch B: the long waves of T1 are")


@pytest.fixture
def stone(tmp_path):
    """A folder with a flat face, and with what its wear said of its use, taken or not."""

    def stone(*, adopted):
        face = mesh_face(make_surface(np.zeros((16, 16)), 0.25), error=0.0, vertices=9, seed=1)
        for field in face.values():
            field.attrs |= {"units": "mm", "long_name": "of the face"}
        write_dataset(tmp_path / "face.h5", face)
        found = {
            "weight": [0.5, 0.5],
            "y_mm": [1.5, 2.5],
            "x_mm": [2.0, 3.0],
            "radius_mm": [np.nan] * 2,
        }
        units = {"units": "1", "long_name": "of a draw"}
        draws = {name: ("draw", values, units) for name, values in found.items()}
        # the strikes do not scatter
        same = (("draw", "patch"), np.ones((2, 2)), units)
        draws |= {"pressure": same, "pressure_at_centre": same}
        use = xr.Dataset(
            draws, {"patch": ["A", "B"]}, {"adopted": adopted, "stated_radius_mm": np.nan}
        )
        write_dataset(tmp_path / "use.h5", use)
        return tmp_path

    return stone


@pytest.mark.parametrize("adopted", [True, False])
def test_a_gesture_goes_on_where_the_wear_says_that_it_was_pressed(stone, tmp_path, adopted):
    stone(adopted=adopted)
    poses = stroke_poses(stroke_mm=0.0, poses=1, force_N=16.0)
    script_of("press_poses").main(
        tmp_path / "face.h5",
        [],
        tmp_path / "use.h5",
        tmp_path / "batch.h5",
        size_mm=4.0,
        load_point=(2.0, 1.5),
        poses=poses.to_dict(),
        patches={"patch": ["A"], "x_mm": [2.0], "y_mm": [2.0], "rotation_deg": [0.0]},
        contact_modulus_MPa=1e4,
        tolerance=1e-8,
        patch_mm=1.0,
        shown=[0],
    )
    pressure = read_dataset(tmp_path / "batch.h5").pressure.isel(shown=0)
    centre = [float((pressure * pressure[axis]).sum() / pressure.sum()) for axis in "yx"]
    assert centre == pytest.approx([2.0, 2.5] if adopted else [2.0, 1.5])


@pytest.mark.parametrize("adopted", [True, False])
def test_intervals_are_drawn_about_the_use_that_the_wear_tells(stone, tmp_path, adopted):
    """Each patch lies where one of two uses presses; the stated one is certain."""
    stone(adopted=adopted)
    patches = {"patch": ["A", "B"], "x_mm": [2.0, 3.0], "y_mm": [1.5, 2.5], "rotation_deg": 0.0}
    pressures = pd.DataFrame(patches).assign(pressure_MPa=1.0, square_pressure_MPa=1.0)
    pressures.to_csv(tmp_path / "pressures.csv", index=False)
    errors = dict.fromkeys(Errors._fields, 0.0)
    stones = {"young_1_MPa": 2e4, "poisson_1": 0.2, "young_2_MPa": 2e4, "poisson_2": 0.2}
    script_of("bound_pressures").main(
        tmp_path / "face.h5",
        [],
        [],
        tmp_path / "use.h5",
        tmp_path / "pressures.csv",
        tmp_path / "patch_intervals.csv",
        uncertainty=errors,
        material=stones | {"contact_modulus_MPa": 1e4},
        load={"force_N": 16.0, "load_point": (2.0, 1.5)},
        radius_mm=None,
        patch_mm=1.0,
        seed=1,
    )
    found = read_table(tmp_path / "patch_intervals.csv")
    assert ((found.high_MPa > 1.1 * found.low_MPa) == adopted).all()


@pytest.mark.parametrize(("least_MPa", "count"), [(5.0, 0), (500.0, 1)])
def test_a_study_that_no_patch_enters_is_told(tmp_path, caplog, least_MPa, count):
    pressures, table = tmp_path / "pressures.csv", tmp_path / "patch_pressures.csv"
    columns = "patch,x_mm,y_mm,rotation_deg,force_N,pressure_MPa,peak_pressure_MPa"
    rows = "A,1,1,0,12,12,20,9\nB,2,1,0,0,0,0,9\n"
    pressures.write_text(f"{columns},square_pressure_MPa\n{rows}")
    surface = rough(5, spacing=0.1)
    contact = contact_at_pressure(interface(surface), Load(20.0), modulus=1e4, tolerance=1e-6)
    write_dataset(tmp_path / "contact.h5", contact.to_dataset())
    given = tmp_path / "contact.h5", pressures, [], table
    selection = {"minimum_pressure_MPa": least_MPa}
    script_of("select_patches").main(*given, patch_mm=1.0, selection=selection)
    assert sum("no patch enters the study" in message for message in caplog.messages) == count


def test_the_exposure_is_that_of_every_batch(tmp_path):
    flat = make_surface(np.zeros((8, 8)), 0.5)
    flat.attrs.update(units="mm", long_name="height")
    poses = stroke_poses(stroke_mm=1.0, poses=2, force_N=32.0)
    settings = {"contact_modulus_MPa": 1e4, "tolerance": 1e-8, "patch_mm": 1.0}
    files = [tmp_path / f"{number}.h5" for number in poses.index]
    for number, file in enumerate(files):
        gesture = Gesture(flat, None, 4.0, (2.0, 2.0), poses[number : number + 1])
        patches = pd.DataFrame({"patch": ["A"], "x_mm": 2.0, "y_mm": 2.0, "rotation_deg": 0.0})
        write_dataset(file, press_poses(flat, gesture, patches, **settings))
    (tmp_path / "pressures.csv").write_text("patch,pressure_MPa\nA,2\n")
    outputs = tmp_path / "fields.h5", tmp_path / "exposure.csv"
    script_of("gather_exposure").main(files, tmp_path / "pressures.csv", *outputs)
    # 32 N on 16 mm², over both halves of a millimetre
    assert float(read_dataset(outputs[0]).exposure.mean()) == pytest.approx(2.0)
