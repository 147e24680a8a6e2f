"""What two scales cost, over many generated specimens: the figures of docs/two_scales.md.

Each specimen is scanned and meshed with all the errors of the default config, or with one of them
changed, and taken through the study up to the contact of its patches. One contact of its whole true
surface at the scans' resolution is the reference. Rows go to a CSV as they are found; those that it
holds already are not computed again. A specimen takes about 3 minutes of CPU and 1.7 GB.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import trimesh
import xarray as xr
import yaml

from gst.patches import read_patches
from gstlib.contact import contact_moduli
from gstlib.geometry import Place, places_of
from gstlib.placement import ALL
from gstlib.preprocess.leveling import remove_plane
from gstlib.reference import patches_of_reference, press_whole, two_scales_table
from gstlib.specimen.generate import within_square
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.specimen.scanning import place_scans, sample, take_scan
from gstlib.specimen.stone import Stone
from gstlib.study import LEVELLED, PLACED, Study
from gstlib.surface import make_surface
from gstlib.uncertainty import Errors, Macroscale, pressure_intervals

ROOT = Path(__file__).parents[1]
# What each trial changes in the config; the first has all errors as they are.
TRIALS: dict[str, dict] = {
    "default": {},
    "mesh noise 0 µm": {"specimen": {"mesh_noise_um": 0.0}},
    "mesh noise 2 µm": {"specimen": {"mesh_noise_um": 2.0}},
    "mesh noise 10 µm": {"specimen": {"mesh_noise_um": 10.0}},
    "placement 0 µm": {"specimen": {"placement_error_um": 0.0}},
    "placement 100 µm": {"specimen": {"placement_error_um": 100.0}},
    "S-filter none": {"microscale": {"s_filter_um": None}},
    "S-filter 10 µm": {"microscale": {"s_filter_um": 10.0}},
    "linear gridding": {"macroscale": {"interpolation": "linear"}},
}
FLAT = make_surface(np.zeros((2, 2)), 1.0)
CAN_BE_KNOWN = {"young_share": 0.0, "poisson": 0.0}  # the specimen's constants are


def scanned(
    stone: Stone, surface: np.ndarray, patches: pd.DataFrame, parameters: SpecimenParameters
) -> tuple[dict[str, xr.DataArray], pd.DataFrame, dict[str, tuple[float, float]]]:
    """Scans before use, their true places and their true slopes."""
    scans, places, slopes = {}, [], {}
    for row in patches.itertuples():
        nominal = Place(row.y_mm, row.x_mm, row.rotation_deg)
        place, _ = place_scans(
            row.patch, nominal, parameters, square_mm=stone.square_mm, poor_overlap=False
        )
        true = sample(surface, stone, place, parameters.scan_points, order=3, patch=row.patch)
        plane = remove_plane(make_surface(true, parameters.scan_spacing_mm))[1]
        slopes[row.patch] = plane.slope_y, plane.slope_x
        scans[row.patch], _ = take_scan(true, row.patch, "T0", parameters)
        places.append({"patch": row.patch} | place._asdict())
    return scans, pd.DataFrame(places), slopes


def trial(
    name: str, base: dict, stone: Stone, surface: np.ndarray, pressure: xr.DataArray
) -> pd.DataFrame:
    """Every patch of one specimen with one set of errors, by variant."""
    config = {
        key: base[key] | TRIALS[name].get(key, {}) if isinstance(base[key], dict) else base[key]
        for key in base
    }
    parameters = SpecimenParameters(**config["specimen"])
    stone._parameters = parameters  # the surface depends on none of the errors
    patches = config["patches"].assign(t1="")  # they are scanned before use alone
    scans, places, slopes = scanned(stone, surface, patches, parameters)
    vertices, faces = stone.mesh()
    study = Study(
        config,
        patches,
        read_mesh=lambda: trimesh.Trimesh(vertices, faces, process=False),
        read_scan=lambda patch, epoch: scans[patch],
    )
    places = places_of(places)
    reference = patches_of_reference(pressure, places, next(iter(scans.values())))
    contacts = {
        variant: {patch: study.contact_in(variant, patch) for patch in places}
        for variant in (PLACED, LEVELLED)
    }
    table = two_scales_table(
        contacts, reference.expand_dims("draw"), rim=config["validation"]["rim"]
    )
    composite = study.composite()
    true = pd.DataFrame(slopes, index=["true_slope_y", "true_slope_x"]).T.rename_axis("patch")
    found = composite[["slope_y", "slope_x", "tilt_error_mrad", "known"]].to_dataframe()
    table = table.merge(found.join(true).reset_index(), on="patch", how="left")
    if name == "default":
        limits = pressure_intervals(
            Macroscale(study.square(), composite, None),
            study.pressures(),
            config["material"],
            Errors(**config["uncertainty"] | CAN_BE_KNOWN),
            target_pressure_MPa=config["macroscale"]["target_pressure_MPa"],
            patch_mm=config["scans"]["size_mm"],
            seed=config["seed"],
        )
        columns = ["patch", "low_MPa", "high_MPa"]
        table = table.merge(limits[columns], on="patch", how="left")
    return table.assign(trial=name, seed=parameters.seed)


def specimen(base: dict, seed: int, trials: list[str]) -> pd.DataFrame:
    """All trials of one specimen."""
    base = base | {"specimen": base["specimen"] | {"seed": seed}}
    parameters = SpecimenParameters(**base["specimen"])
    stone = Stone(replace(parameters), base["square"]["size_mm"])
    surface = (stone.macroscale(stone.grid, stone.grid) + stone.detail).astype(np.float32)
    heights = within_square(surface, stone).astype(float)
    pressed = press_whole(
        heights,
        FLAT,
        contact_modulus_MPa=contact_moduli(base["material"])[0],
        target_pressure_MPa=base["macroscale"]["target_pressure_MPa"],
    )
    return pd.concat([trial(name, base, stone, surface, pressed.pressure) for name in trials])


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """By trial and variant: pooled F1 with a 95 % bootstrap interval over specimens, and more.

    ``misplaced``: share of the force that is on the wrong patch, half the sum of the differences of
    the patches' shares. ``held``: share of the patches whose true pressure is in its interval.
    """
    generator = np.random.default_rng(1)
    found = []
    for (trial_name, variant), group in rows.groupby(["trial", "variant"], sort=False):
        patches = group[group.patch != ALL]
        size = patches.groupby("seed")
        hits = (
            (patches.contact_fraction * patches.precision.fillna(0)).groupby(patches.seed).sum()
        )
        marked = size.contact_fraction.sum() + size.reference_contact_fraction.sum()
        counts = np.stack([2 * hits, marked], axis=1)
        drawn = counts[generator.integers(0, len(counts), (9999, len(counts)))].sum(axis=1)
        low, high = np.percentile(drawn[:, 0] / drawn[:, 1], [2.5, 97.5])
        row = {
            "trial": trial_name,
            "variant": variant,
            "specimens": len(counts),
            "f1": counts[:, 0].sum() / counts[:, 1].sum(),
            "low": low,
            "high": high,
            "area_ratio": size.contact_fraction.sum().sum()
            / size.reference_contact_fraction.sum().sum(),
        }
        if patches.pressure_MPa.notna().all():
            shares = [
                patches[name] / size[name].transform("sum")
                for name in ("pressure_MPa", "reference_pressure_MPa")
            ]
            row["misplaced"] = (shares[0] - shares[1]).abs().sum() / 2 / len(counts)
        if variant == "placed":
            known = patches[patches.known.astype(bool)]
            errors = [known[f"slope_{axis}"] - known[f"true_slope_{axis}"] for axis in "yx"]
            row["tilt_error_mrad"] = 1e3 * np.sqrt(np.mean(np.square(errors)))
            row["stated_tilt_error_mrad"] = np.sqrt((known.tilt_error_mrad**2).mean())
            limited = patches.dropna(subset="low_MPa") if "low_MPa" in patches else patches[:0]
            if len(limited):
                true = limited.reference_pressure_MPa
                row["held"] = true.between(limited.low_MPa, limited.high_MPa).mean()
        found.append(row)
    return pd.DataFrame(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(3001, 3021)))
    parser.add_argument("--trials", nargs="+", choices=TRIALS, default=list(TRIALS))
    parser.add_argument("--rows", type=Path, default=Path("build/two_scales.csv"))
    options = parser.parse_args()
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    config["microscale"]["tolerance"] = 1e-6  # no point of contact changes
    config["patches"] = read_patches(
        ROOT / config["patches"],
        size_mm=config["square"]["size_mm"],
        patch_size_mm=config["scans"]["size_mm"],
    )
    options.rows.parent.mkdir(parents=True, exist_ok=True)
    known = pd.DataFrame({"seed": [], "trial": []})
    if options.rows.exists():
        known = pd.read_csv(options.rows, dtype={"patch": str})
    for seed in options.seeds:
        there = set(known.trial[known.seed == seed])
        if not (missing := [name for name in options.trials if name not in there]):
            continue
        known = pd.concat([known, specimen(config, seed, missing)], ignore_index=True)
        known.to_csv(options.rows, index=False)
        print(f"seed {seed} done", flush=True)
    table = summary(known).round(4)
    print(table.to_string(index=False))
    table.to_csv(ROOT / "benchmarks/results/two_scales.csv", index=False)


if __name__ == "__main__":
    main()
