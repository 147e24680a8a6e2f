"""The methods paragraph says what a study did, and nothing that it did not do."""

import jinja2
import pytest
import yaml

from gst import ROOT
from gst.config.reading import read_config
from gst.page.methods import methods_text
from gstlib.io.tables import read_table

PACKAGES = dict.fromkeys(("numpy", "scipy", "trimesh", "snakemake"), "1.2.3")
SOFTWARE = {"gstlib": "9.8", "commit": "abc", "python": "3.99", "packages": PACKAGES}
WHOLE = {"patch_pressures", "microscale_summary", "registration", "use", "wear"}
WHOLE |= {"validation_summary"}


def methods(name, tables=WHOLE, changed="{}"):
    config = read_config(ROOT / f"config/{name}.yaml") | yaml.safe_load(changed)
    return methods_text({"config": config, "software": SOFTWARE}, tables)


@pytest.mark.parametrize(
    ("name", "changed", "words"),
    [
        ("config", "{}", "is synthetic; 550 N through the middle; of 10346 MPa"),
        ("config", "{}", "of 200 mm radius; gstlib 9.8 implements it (commit abc), on"),
        ("config", "{}", "at most 2000 MPa; at least 8 adjacent; Archard J.F. (1953)"),
        ("config", "accept: [face]", "accepts: face."),
        ("config", "counterface: {radius_mm: [50, 80.5]}", "50 mm and 80.5 mm"),
        ("config", "counterface: null", "against a flat."),
        ("two_tools", "{}", "against the mesh of an active tool.; poses of a gesture"),
        ("interlayer", "{}", "an elastic layer took turns in wearing (300 MPa"),
        ("m12", "{}", "on its mean plane with 550 N against a flat; of 12820 MPa"),
        ("m12", "{}", "interpolated linearly; at most 1 % of the points"),
    ],
)
def test_settings_of_the_study_are_stated(name, changed, words):
    text = methods(name, changed=changed)
    for word in words.split("; "):
        assert word in text
    assert "None" not in text


@pytest.mark.parametrize(
    ("name", "tables", "absent"),
    [
        ("mesh_only", {"places"}, "synthetic scan registered Archard inferred"),
        ("artefact", {"use"}, "registered Archard losses"),
        ("m12", WHOLE - {"use"}, "synthetic inferred S-filter tilt"),
    ],
)
def test_what_a_study_has_not_done_is_left_out(name, tables, absent):
    text = methods(name, tables)
    for word in absent.split():
        assert word not in text


def test_the_load_of_the_contacts_is_stated():
    config = {"config": read_config(ROOT / "config/config.yaml"), "software": SOFTWARE}
    use = read_table(ROOT / "tests/baseline/tables/use.csv")
    assert "load point at x 2.21 mm, y 3.14 mm and a radius of 156 mm." in (
        methods_text(config, WHOLE, use)
    )
    kept = methods_text(config, WHOLE, use.assign(adopted=False))
    assert "the given load was kept" in kept
    assert "2.21 mm" not in kept


def test_a_provenance_without_a_section_is_refused():
    with pytest.raises((LookupError, jinja2.TemplateError)):
        methods_text({"config": {"load": {"force_N": 1}}, "software": SOFTWARE}, WHOLE)
