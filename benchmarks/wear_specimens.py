"""What the prediction of wear is worth, over generated specimens: the figures of docs/wear.md.

Each specimen of fresh seed, with the settings and errors of the default config, goes through the
study in memory. Trials change one value of the config, or fix the coefficient of a mat. Rows of
``wear.csv`` go to a CSV as they are found; those that it holds already are not computed again. A
specimen takes about 2 minutes of CPU, each trial up to one more.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from power import CONFIG, specimen_config, specimen_studies

from gst.patches import read_patches
from gst.sweep import merged
from gstlib.specimen.stone import WEAR_LAWS
from gstlib.study import Study
from gstlib.validation.wear_scores import wear_table
from gstlib.wear import fit_mat, wear_patches

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks/results/wear_specimens.csv"
MAT = {"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 300.0}
TRIALS: dict[str, dict] = {
    "default": {},
    "contact modulus - 20 %": {"material": {"contact_modulus_MPa": 10256.0}},
    "contact modulus + 20 %": {"material": {"contact_modulus_MPa": 15384.0}},
    "target pressure - 20 %": {"load": {"force_N": 440.0}},
    "target pressure + 20 %": {"load": {"force_N": 660.0}},
    "mesh noise 0 µm": {"specimen": {"mesh_noise_um": 0.0}},
    "mesh noise 2 µm": {"specimen": {"mesh_noise_um": 2.0}},
    "mesh noise 10 µm": {"specimen": {"mesh_noise_um": 10.0}},
    "mat": {"mat": MAT},
    "mat, ratio 0.1": {"mat": MAT, "ratio": 0.1},
    "mat, ratio 1": {"mat": MAT, "ratio": 1.0},
    "mat, ratio 1, 100 MPa": {"mat": MAT | {"young_MPa": 100.0}, "ratio": 1.0},
    "mat, ratio 1, 1000 MPa": {"mat": MAT | {"young_MPa": 1000.0}, "ratio": 1.0},
    "mat, ratio 1, 100 µm": {"mat": MAT | {"thickness_um": 100.0}, "ratio": 1.0},
    "mat, ratio 1, 1000 µm": {"mat": MAT | {"thickness_um": 1000.0}, "ratio": 1.0},
}
RIVALS = "archard", "pressure", "uniform", "truncation"


def trial(
    name: str, config: dict, patches: pd.DataFrame, seed: int, kept: dict
) -> pd.DataFrame:
    """Rows of ``wear.csv`` of one specimen; `kept` passes on its scans and their changes."""
    config = merged(config, TRIALS[name])
    ((_, study),) = specimen_studies(config, patches, seed, ["summits"])
    known = {of: found for of, found in kept.items() if of[0] in ("prepared", "change")}
    study = Study(
        config, patches, read_mesh=study.read_mesh, read_scan=study.read_scan, kept=known
    )
    worn = study.worn_square()
    if worn is None:
        raise SystemExit(f"seed {seed}, {name}: no wear is predicted")
    contacts = {patch: study.patch_contact(patch) for patch in worn.losers}
    changes = {patch: study.change(patch) for patch in worn.losers}
    fitted = None
    if worn.mat is not None:
        ratios = [config["ratio"]] if "ratio" in config else worn.path.ratio.values
        at_ratios = worn._replace(path=worn.path.sel(ratio=ratios))
        fitted = fit_mat(at_ratios, contacts, changes)
    losses = dict(wear_patches(worn, fitted, contacts))
    table, _ = wear_table(contacts, changes, losses, worn.path)
    if fitted is not None:
        ratios = fitted.mat_ratio.to_series().rename("mat_ratio")
        table = table.merge(ratios, left_on="patch", right_index=True)
    kept.update(study.kept)
    return table.assign(trial=name, seed=seed)


def out_of_contact(seed: int) -> pd.DataFrame:
    """What a mat gains where the bare stone takes off nothing that is detected, by law of wear.

    On the coarse specimens of `make power`; the gain is the share of the bare stone's error.
    """
    config = specimen_config(CONFIG)
    rows = []
    for law, study in specimen_studies(config, worn_patches(config), seed, WEAR_LAWS):
        table, *_ = study.wear(seed=1, resamples=99)
        wide = table.pivot(
            index="patch", columns="model", values="rms_out_of_contact_um"
        ).dropna()
        rows.append((seed, law, 1 - wide["mat"].sum() / wide["archard"].sum()))
    return pd.DataFrame(rows, columns=["seed", "worn_by", "gain"])


def worn_patches(config: dict) -> pd.DataFrame:
    """The patches of a config that have a T1."""
    patches = read_patches(
        ROOT / config["patches"],
        size_mm=config["square"]["size_mm"],
        patch_size_mm=config["scans"]["size_mm"],
    )
    return patches[patches.t1 != ""].reset_index(drop=True)


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """By trial: skills of the last model, pooled, with 95 % bootstrap intervals over specimens.

    ``moved``: sum of the changes of the patches' predicted volumes, from those of the default
    trial, over their sum there.
    """
    errors = {
        "volume": (rows.predicted_volume_um3 - rows.measured_volume_um3).abs(),
        "depth": (rows.predicted_depth_um.fillna(0) - rows.measured_depth_um.fillna(0)).abs(),
        "map": rows.rms_difference_um,
    }
    place = ["seed", "patch"]
    base = rows[(rows.trial == "default") & (rows.model == "archard")].set_index(place)
    found = []
    for name, group in rows.groupby("trial", sort=False):
        own = "mat" if name.startswith("mat") else "archard"
        volumes = group[group.model == own].set_index(place).predicted_volume_um3
        before = base.predicted_volume_um3.reindex(volumes.index)
        row: dict = {"trial": name, "specimens": group.seed.nunique()}
        row["moved"] = (volumes - before).abs().sum() / before.sum()
        for quantity, error in errors.items():
            wide = group.assign(error=error[group.index]).pivot_table(
                index="seed", columns="model", values="error", aggfunc="sum"
            )
            generator = np.random.default_rng(1)
            drawn = generator.integers(len(wide), size=(9999, len(wide)))
            for rival in RIVALS:
                if rival == own or (quantity == "depth" and rival in ("pressure", "uniform")):
                    continue
                pair = wide[[own, rival]].to_numpy()
                samples = 1 - np.divide(*pair[drawn].sum(axis=1).T)
                value = 1 - np.divide(*pair.sum(axis=0))
                low, high = np.percentile(samples, [2.5, 97.5])
                row[f"{quantity} vs {rival}"] = f"{value:.2f} [{low:.2f}, {high:.2f}]"
        found.append(row)
    return pd.DataFrame(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(4001, 4021)))
    parser.add_argument("--trials", nargs="+", choices=TRIALS, default=["default"])
    parser.add_argument("--rows", type=Path, default=Path("build/wear_specimens.csv"))
    parser.add_argument("--laws", action="store_true", help="what a mat gains out of contact")
    options = parser.parse_args()
    if options.laws:
        found = pd.concat([out_of_contact(seed) for seed in options.seeds])
        print(found.round(3).to_string(index=False))
        return
    config = specimen_config()
    patches = worn_patches(config)
    options.rows.parent.mkdir(parents=True, exist_ok=True)
    rows = pd.read_csv(options.rows, dtype={"patch": str}) if options.rows.exists() else None
    for seed in options.seeds:
        kept: dict = {}
        for name in options.trials:
            if rows is not None and ((rows.seed == seed) & (rows.trial == name)).any():
                continue
            rows = pd.concat(
                [rows, trial(name, config, patches, seed, kept)], ignore_index=True
            )
            rows.to_csv(options.rows, index=False)
            print(f"seed {seed}, {name}: done", flush=True)
    table = summary(rows)
    print(table.to_string(index=False))
    table.round(3).to_csv(RESULT, index=False)


if __name__ == "__main__":
    main()
