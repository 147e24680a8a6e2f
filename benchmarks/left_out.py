"""What changes on a patch if something that the study states or leaves out is otherwise.

    python benchmarks/left_out.py [--seeds 8001 8002] [--processes 2]
    python benchmarks/left_out.py --tables

Of the patches of benchmarks/strikes.py: with the paper's contact modulus; with a cap on the
pressure; and worn on the same place again and again by a tool that wears as much as the stone. Of
its stones, under the use that is stated: the share of the patches' force that lies on other
patches, against a tool of two radii, 1.56 to 1 like the paper's, of the same geometric mean, in
three directions, and with more of the stone around the square, against the stated radius and twice
that; and the share of their loss that lies on other patches, if the stone comes to rest anew while
it wears. Rows go to `results/left_out.csv`; `--tables` prints the table of
docs/explanation/evidence.md from them.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
from runner import RESULTS, means, run_stones
from specimens import changed
from strikes import SEEDS, loaded_contacts, solved, stone
from use import ASPECT

from gstlib.conditions import study_radius
from gstlib.contact import contact_at_pressure
from gstlib.coupling.pressures import patch_means
from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.wear.archard import wear_contact

ROWS = RESULTS / "left_out.csv"
OTHERWISE = {
    "E* 12,820 MPa": {"contact_modulus": 12820.0},
    "cap of 2 GPa": {"pressure_cap": 2000.0},
    "cap of 1 GPa": {"pressure_cap": 1000.0},
}
# How far the longer of two radii is turned from x.
ANGLES_DEG = 0.0, 60.0, 120.0
# Wear coefficient times sliding: half a micrometre at 25 MPa.
KAPPA = 2e-5  # mm/MPa
# The face that is pressed, over that of the config.
WIDER = 1.25


def otherwise(contact):
    """A row for each thing that is otherwise on one patch."""
    stated = solved(contact)
    for name, options in OTHERWISE.items():
        other = solved(contact, **options)
        common = np.count_nonzero(stated.contact & other.contact)
        both = np.count_nonzero(stated.contact) + np.count_nonzero(other.contact)
        ratio = other.contact_fraction / stated.contact_fraction
        yield {"changed": name, "contact_ratio": ratio, "f1": 2 * common / both}
    pressure = contact.load.mean_pressure
    alone, both = (
        wear_contact(
            contact, "", mean_pressure=pressure, mean_loss=faces * KAPPA * pressure
        ).depth
        / faces
        for faces in (1, 2)
    )
    yield {
        "changed": "the tool wears, too",
        "deepest_ratio": both.max() / alone.max(),
        "map_difference": np.sqrt(np.mean((both - alone) ** 2) / np.mean(alone**2)),
    }


def as_stated(study, **changes):
    """The same stone, pressed as the config states, with some of it changed."""
    return changed(study, {"use": None} | changes)


def against_two_radii(stated):
    """A row for each direction of a tool of two radii in place of the round one."""
    radius = study_radius(stated.config)
    middle = stated.config["square"]["size_mm"] / 2
    radii = radius * ASPECT**0.5, radius / ASPECT**0.5
    for angle in ANGLES_DEG:
        over = rounded_counterface(
            stated.composite.height, radii, (middle, middle), angle
        )
        other = as_stated(stated)
        other.composite = stated.composite.assign(counterface=over)
        share = moved(stated.pressures.force_N, other.pressures.force_N)
        yield {
            "patch": f"all, {angle:g}°",
            "changed": "two radii",
            "force_moved": share,
        }


def on_wider_faces(stated):
    """A row for each radius of the tool, with more of the stone around the square pressed."""
    radius = study_radius(stated.config)
    face_mm = stated.config["macroscale"]["face_mm"]
    wider = {"macroscale": {"face_mm": WIDER * face_mm}}
    for times in (1, 2):
        tool = {"counterface": {"radius_mm": times * radius}}
        forces = [
            as_stated(stated, **changes).pressures.force_N
            for changes in (tool, tool | wider)
        ]
        name = f"wider face, {times} x radius"
        yield {"patch": "all", "changed": name, "force_moved": moved(*forces)}


def tilting(stated):
    """A row for a stone that comes to rest anew in each step of its wear."""
    lost = [worn(stated, is_held=is_held) for is_held in (True, False)]
    return {"patch": "all", "changed": "it tilts", "loss_moved": moved(*lost)}


def worn(stated, *, is_held):
    """What each patch loses while the face wears with the tilt that it has before use, or not."""
    contact = stated.contact
    steps = stated.config["wear_steps"]
    pressure = contact.load.mean_pressure
    size_mm = stated.config["scans"]["size_mm"]
    of_patches = patch_means(contact.pressure, stated.patches, size_mm=size_mm)
    lost = np.zeros(contact.pressure.shape)
    for _ in range(steps):
        options = {
            "mean_pressure": pressure,
            "mean_loss": KAPPA * pressure / steps,
            "steps": 1,
        }
        depth = wear_contact(contact, "", **options).depth
        lost += depth
        lower = replace(contact.interface, height=contact.interface.height - depth)
        contact = replace(contact, interface=lower)
        if not is_held:
            solved = {"modulus": contact.modulus, "tolerance": contact.tolerance}
            contact = contact_at_pressure(contact.interface, contact.load, **solved)
    return of_patches @ lost.ravel()


def moved(stated, other):
    """The share of what the patches bear or lose that lies on other patches."""
    return float(np.abs(other - stated).sum() / 2 / np.sum(stated))


def rows_of(seed):
    study = stone(seed)
    rows = [
        {"patch": patch} | row
        for patch, contact in loaded_contacts(study).items()
        for row in otherwise(contact)
    ]
    stated = as_stated(study)
    rows += [*against_two_radii(stated), *on_wider_faces(stated), tilting(stated)]
    return pd.DataFrame([{"seed": seed} | row for row in rows]).round(4)


def summary(rows):
    """Means over the patches, or over the stones and directions."""
    return means(rows, ["changed"], "cases")


if __name__ == "__main__":
    run_stones(__doc__, ROWS, rows_of, lambda rows: [summary(rows).round(3)], SEEDS)
