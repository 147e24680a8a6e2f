"""What registration and height change do on measured surfaces, for docs/explanation/evidence.md.

    python benchmarks/measured_surfaces.py
    python benchmarks/measured_surfaces.py --tables

The files lie beside the project, in ../shared/data, whose PROVENANCE.md has their sources; without
them the program ends with a message.

**Repeats**, to benchmarks/results/repeats.csv: an atomic force microscope measures each line of a
place twice, trace and retrace. Nothing changes between the two, so all loss and gain is false.
Lengths are multiplied by 1000, because the limits of the project are those of confocal scans. A row
has what the study states of the pair in its table ``registration``, and:

serves           whether the pair is accepted as a repeat that gives the error of a change;
points, spacing_um   of the scan, along a side;
neighbours_*     correlation of the errors of points that are neighbours along y or x;
length_*         distance in points along y or x from which on errors correlate by less than 1/e;
white_loss, white_gain   loss and gain for white noise of the same size on the same surface;
message          why the pair cannot be registered, if it cannot.

**Breech faces**, to benchmarks/results/breech_faces.csv: confocal scans of three cartridge primers
for each of five breech faces, which stamped them. Two of one breech face are *related*: they show
one surface on two castings. Pieces of `SIDE` points are cut from both where they show the same
place. The second is shifted by up to `SHIFT` of its side and turned by up to `TURN`, by chance.
Pieces overlap, so they are no independent trials. Two of different breech faces are *unrelated*;
their pieces are cut anywhere, and moved likewise. A row has the place, shift and turn of the piece,
and:

found            whether the registration is believed;
error_um, turn_error_deg   its errors;
correlation, dale_depth_ratio   as it states them;
message          why the pair cannot be registered, if it cannot.
"""

from functools import cache
from itertools import combinations, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
import yaml
from runner import RESULTS, ROOT, options, save
from specimens import specimen_config

from gstlib.change.change import estimate_detection_limit, register_patch, wear_summary
from gstlib.change.registration import register
from gstlib.change.selection import registration_table
from gstlib.errors import InputError
from gstlib.io.scans import read_scan
from gstlib.io.tables import read_table
from gstlib.preprocess.scans import prepare_scan
from gstlib.surfaces.fitting import robust_sigma
from gstlib.surfaces.footprints import PatchPosition, spline_of
from gstlib.surfaces.grid import MM_TO_UM, axis_coordinates, make_surface, spacing_of

DATA = ROOT.parent / "shared/data"
# The shift that is searched for, in sides of a scan: that of the default study.
REACH = 0.6 / 0.85
SETTINGS = {"minimum_cluster_points": 8}

FILES = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())
LARGER = 1000.0

SIDE, SHIFT, TURN = 80, 0.25, 12.0  # points, sides, degrees
# Turns (degrees) up to this are counted apart from those that a registration may not reach.
NEAR = 6.0
# Points of the common grid along a side, about whose middle castings are turned.
GRID = 640
# Pieces that are cut from each pair of castings, evenly from those `STEP` points apart, and how
# much of a piece may be undefined before the second is shifted.
RELATED, UNRELATED = 22, 17
STEP, UNDEFINED = 16, 0.05
# A match of two castings is wrong beyond this: the turns above are right to 0.1°, a point or two.
WRONG_UM = 5 * 6.25


def channel(file, number):
    """One channel of a file as a prepared scan, `LARGER` than it is."""
    from SurfaceTopography import open_topography
    from SurfaceTopography.Support.UnitConversion import get_unit_conversion_factor

    topography = open_topography(DATA / file).topography(channel_index=number)
    factor = LARGER * get_unit_conversion_factor(topography.unit, "mm")
    heights = np.asarray(topography.heights(), dtype=float).T * factor
    spacing = topography.physical_sizes[0] * factor / heights.shape[1]
    return prepare_scan(make_surface(heights, spacing))


def neighbours(change):
    """How errors correlate along y and x: of neighbours, and over which distance."""
    error = change["change"].values
    bound = 3 * robust_sigma(error[np.isfinite(error)])
    error = np.nan_to_num(np.clip(error, -bound, bound))
    for name, along in (("y", error), ("x", error.T)):
        spectrum = np.abs(scipy.fft.rfft(along, 2 * len(along), axis=0)) ** 2
        lags = scipy.fft.irfft(spectrum, axis=0).sum(axis=1)[: len(along)]
        correlation = lags / lags[0]
        yield f"neighbours_{name}", float(correlation[1])
        yield f"length_{name}_points", float(np.argmax(correlation < 1 / np.e))


def repeat_row(name):
    """What the study says of one pair of repeats."""
    file, *channels = FILES["repeats"][name]
    first, second = (channel(file, number) for number in channels)
    points, spacing = len(first.height), spacing_of(first.height)[0]
    settings = SETTINGS | {"maximum_shift_mm": REACH * points * spacing}
    row = {"pair": name, "points": points, "spacing_um": MM_TO_UM * spacing}
    try:
        change = register_patch(first, second, patch=name, **settings)
    except InputError as error:
        return row | {"message": error.problem}
    config = specimen_config()
    limit = config["validation"]["max_gain_to_loss_ratio"]
    table = registration_table(
        {name: change}, config["selection"], max_gain_to_loss_ratio=limit
    )
    row |= table.iloc[0].drop("patch").to_dict()
    again = {"before": {name: first}, "again": {name: second}}
    row["serves"] = estimate_detection_limit(**again, **settings) is not None
    if change.attrs["known_fraction"]:
        row |= dict(neighbours(change))
        noise = np.random.default_rng(1).standard_normal(first.height.shape)
        noisy = first.height + noise * change.attrs["change_sigma_um"] / MM_TO_UM
        noisy = first.assign(height=noisy)
        white = wear_summary(register_patch(first, noisy, patch=name, **settings))
        row["white_loss"] = white["loss_fraction"]
        row["white_gain"] = white["gain_fraction"]
    return row


class Casting(NamedTuple):
    """A scan of a primer, and how its points lie on the common grid of its breech face."""

    spline: object
    undefined: np.ndarray  # (ny, nx), 0 or 1
    spacing: float
    laid: list

    def piece(self, place):
        """Heights about a place (points of the common grid), mm, NaN where undefined."""
        steps = np.arange(SIDE) - (SIDE - 1) / 2
        return self._at(*place.points(steps[:, None], steps))

    def on_grid(self):
        """Which points of the common grid are defined."""
        return np.isfinite(self._at(*np.indices((GRID, GRID))).values)

    def _at(self, y, x):
        turn, *shift = self.laid
        middle = (GRID - 1) / 2
        # as `scipy.ndimage.rotate` turns, which is from y towards x
        rows, columns = PatchPosition(middle, middle, turn).points(
            y - shift[0] - middle, x - shift[1] - middle
        )
        outside = scipy.ndimage.map_coordinates(
            self.undefined, [rows, columns], order=1, cval=1.0
        )
        heights = self.spline.ev(rows * self.spacing, columns * self.spacing)
        return make_surface(np.where(outside > 0, np.nan, heights), self.spacing)


@cache
def casting(name):
    """A scan by its name."""
    scan = read_scan(DATA / f"breechface-ccby/{name}.x3p")
    spacing = spacing_of(scan)[0]
    along = {
        axis: axis_coordinates(count, spacing) - spacing / 2
        for axis, count in zip("yx", scan.shape, strict=True)
    }
    undefined = np.isnan(scan.values).astype(float)
    spline = spline_of(scan.assign_coords(along))
    return Casting(spline, undefined, spacing, FILES["castings"][name])


@cache
def places(name):
    """Places (y, x) of the common grid about which a casting is defined, in their order."""
    share = scipy.ndimage.uniform_filter(casting(name).on_grid().astype(float), SIDE)
    inside = range(SIDE, GRID - SIDE, STEP)
    return [place for place in product(inside, inside) if share[place] >= 1 - UNDEFINED]


def spread(among, count):
    """So many of the places, from the first to the last."""
    return [among[round(at)] for at in np.linspace(0, len(among) - 1, count)]


def breech_rows(kind, first, second):
    """Pieces of two castings on each other: of the same places, or of any that each has."""
    if kind == "related":
        common = [place for place in places(first) if place in places(second)]
        chosen = spread(common, RELATED)
        pairs = zip(chosen, chosen, strict=True)
    else:
        each = (spread(places(name), UNRELATED) for name in (first, second))
        pairs = zip(*each, strict=True)
    for (y, x), (other_y, other_x) in pairs:
        generator = np.random.default_rng([*first.encode(), *second.encode(), y, x])
        v, u, turn = generator.uniform(-1, 1, 3) * (SHIFT * SIDE, SHIFT * SIDE, TURN)
        moved = PatchPosition(other_y + v, other_x + u, turn)
        pieces = casting(first).piece(PatchPosition(y, x)), casting(second).piece(moved)
        t0, t1 = (
            prepare_scan(piece, maximum_unmeasured=1.0).height for piece in pieces
        )
        row = {"kind": kind, "first": first, "second": second, "y": y, "x": x}
        row |= {"shift_y_points": v, "shift_x_points": u, "turn_deg": turn}
        spacing = spacing_of(t0)[0]
        try:
            match = register(t0, t1, maximum_shift_mm=REACH * SIDE * spacing)
        except InputError as error:
            yield row | {"found": False, "message": error.problem}
            continue
        off_mm = match.shift_y_mm - v * spacing, match.shift_x_mm - u * spacing
        yield row | {
            "found": match.is_reliable,
            "error_um": MM_TO_UM * np.hypot(*off_mm),
            "turn_error_deg": abs(match.rotation_deg - turn),
            "correlation": match.detail_correlation,
            "dale_depth_ratio": match.dale_depth_ratio,
        }


def breech_face_rows():
    """All pairs of castings."""
    for first, second in combinations(FILES["castings"], 2):
        kind = "related" if first[:4] == second[:4] else "unrelated"
        yield from breech_rows(kind, first, second)


def summary(rows):
    """Of the breech faces: pairs, those ``found``, and those that are ``refused``.

    ``wrong`` are those of the found ones that lie elsewhere than they should, which unrelated ones
    cannot. Related pairs are counted by whether their turn is `NEAR`.
    """
    is_related = rows.kind == "related"
    is_found = rows.found.astype(bool)
    is_far = is_related & (rows.turn_deg.abs() > NEAR)
    counted = pd.DataFrame({"pairs": 1, "found": is_found})
    counted["wrong"] = (is_found & (rows.error_um > WRONG_UM)).where(is_related)
    counted["refused"] = rows.message.notna()
    counted = counted.astype(float)
    kinds = rows.kind.mask(is_far, "related, turned far")
    return counted.groupby(kinds).sum(min_count=1)


MAKERS = {
    "repeats": lambda: map(repeat_row, FILES["repeats"]),
    "breech_faces": breech_face_rows,
}
SHOWN = """pair found shift_y_um shift_x_um loss_fraction gain_fraction above_noise serves
neighbours_y neighbours_x white_loss white_gain"""


def main():
    chosen = options(__doc__, RESULTS)  # --output is a folder
    if not (chosen.tables or DATA.is_dir()):
        raise SystemExit(f"the measured files are not beside the project ({DATA})")
    for name, make in MAKERS.items():
        file = chosen.output / f"{name}.csv"
        if not chosen.tables:
            rows = pd.DataFrame(make())
            save(file, rows if "message" in rows else rows.assign(message=np.nan))
        rows = read_table(file)
        shown = rows[SHOWN.split()] if name == "repeats" else summary(rows)
        print(shown.to_string())


if __name__ == "__main__":
    main()
