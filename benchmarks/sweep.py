"""Which choices change the results of a study most? One value of its config is changed at a time.

    python benchmarks/sweep.py [--config config/config.yaml] [--settings benchmarks/sweep.yaml]

The study runs in memory (`gstlib.study.Study`), as it is and once for each value in the settings.
What comes out goes to build/sweep.csv, beside what comes out of the study itself; the largest
changes are printed. A synthetic specimen is read from the results: run its study first.
"""

import math
from pathlib import Path

import pandas as pd
import yaml
from runner import options, pooled
from specimens import merged

from gst.config.contradictions import counterface_mesh
from gst.config.patches import read_patches, scan_files
from gst.config.poses import poses_of, reach_of
from gst.config.reading import config_problems, read_config, refuse_config
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from gstlib.io.tables import write_table
from gstlib.macroscale.active_tool import ActiveTool
from gstlib.study import Study
from gstlib.validation.scoring import own_model
from gstlib.validation.summary import statistic_names

SETTINGS = Path(__file__).with_name("sweep.yaml")
_PRESSURE, _CHANGE = "pressure_MPa", "relative_change(pressure_MPa)"
# Rows of ``validation_summary.csv``.
_OF_PREDICTION = ["mean(mcc)", "gain(mcc)", "relative(map_error)"]
_OF_PREDICTION += ["spearman(pressure_MPa, loss_fraction)"]


def study_of(config, folder=Path()):
    """The study of a complete config in memory, with the files that its run in `folder` reads."""
    made = f"{config['results']}/specimen"
    inputs = config["inputs"] or {
        "mesh": f"{made}/mesh.stl",
        "mesh_unit": "mm",
        "scan_folder": f"{made}/scans",
    }
    patches = read_patches(
        folder / config["patches"],
        size_mm=config["square"]["size_mm"],
        patch_size_mm=config["scans"]["size_mm"],
        scan_folder=folder / inputs["scan_folder"],
    )
    scans = scan_files(patches, folder / inputs["scan_folder"], None)
    files = {(scan.patch, scan.epoch): scan.path for scan in scans}
    reading = {name: config["scans"][name] for name in ("unit", "spacing_um")}
    face = (config["counterface"] or {}).get("scan")
    second = counterface_mesh(config, made)
    if second:
        table = (config["gesture"] or {}).get("table")
        moved = {"gesture": {"table": str(folder / table)}} if table else {}
        second |= {
            "mesh": folder / second["mesh"],
            "reach_mm": reach_of(config, poses_of({**config, **moved})),
        }
    return Study(
        config,
        patches,
        read_mesh=lambda: read_mesh(folder / inputs["mesh"], unit=inputs["mesh_unit"]),
        read_scan=lambda *scan: read_scan(files[scan], **reading),
        read_face=(lambda: read_scan(folder / face, **reading)) if face else None,
        active_tool=ActiveTool.read(**second) if second else None,
    )


def outcomes(study):
    """What comes out of a study: ``output, patch, result, low, high``.

    The pressure of every patch; ``studied``, the number of patches in the study; of the predicted
    loss the mean MCC, its gain over the best baseline and the error of its maps over that of no
    loss; the rank correlation of pressure with loss. With 95 % intervals where there are any.
    """
    selected = study.selected
    pressures = selected.rename(columns={_PRESSURE: "result"}).assign(output=_PRESSURE)
    studied = {"output": ["studied"], "patch": "", "result": selected.in_study.sum()}
    tables = [pressures, pd.DataFrame(studied)]
    if study.worn:
        summary = study.scored()["summary"].rename(columns={"value": "result"})
        own = summary[summary.model.isin(["", own_model(list(summary.model))])]
        own = own.assign(output=statistic_names(own), patch="")
        tables.append(own[own.output.isin(_OF_PREDICTION)])
    table = pd.concat(tables, ignore_index=True)
    columns = ["output", "patch", "result", "low", "high"]
    return table.reindex(columns=columns).dropna(subset="result", ignore_index=True)


def changes_table(settings):
    """One row for each of the `outcomes` of each setting: a factor and its value, both in words.

    The first of `settings` is the study itself. ``change`` is the result less the study's. Each
    setting has one more row: the sum of the absolute changes of the patches' pressures over their
    sum.
    """
    keys = ["output", "patch"]
    study = next(iter(settings.values())).set_index(keys).result
    tables = []
    for (factor, value), table in settings.items():
        change = table.result - study.reindex(table.set_index(keys).index).to_numpy()
        share = change[table.output == _PRESSURE].abs().sum() / study[_PRESSURE].sum()
        summed = {"output": [_CHANGE], "patch": "", "result": share, "change": share}
        table = pd.concat([table.assign(change=change), pd.DataFrame(summed)])
        tables.append(table.assign(factor=factor, value=value))
    columns = ["factor", "value", *keys, "result", "change", "low", "high"]
    return pd.concat(tables, ignore_index=True)[columns]


def outcomes_of(setting, config):
    return outcomes(study_of(config)).assign(setting=setting)


def main():
    config = Path("config/config.yaml")
    output = Path("build/sweep.csv")
    chosen = options(__doc__, output, config=config, settings=SETTINGS)
    config = read_config(chosen.config)
    if config["patches"] is None:
        raise SystemExit(
            f"{chosen.config} has no patch table, and a sweep needs patches"
        )
    configs = {("", ""): config}
    for factor, changes in yaml.safe_load(chosen.settings.read_text()).items():
        for change in changes:
            value = yaml.safe_dump(change, default_flow_style=True, width=math.inf)
            # without the outer braces
            configs[factor, value.strip()[1:-1]] = merged(config, change)
    for (factor, value), changed in configs.items():  # all, before any of them runs
        refuse_config(config_problems(changed), f"{chosen.config}, {factor} {value}")
    *_, rows = pooled(outcomes_of, [*enumerate(configs.values())], chosen.processes)
    tables = (outcome for _, outcome in rows.groupby("setting"))
    table = changes_table(dict(zip(configs, tables, strict=True)))
    write_table(chosen.output, table)
    others = table[(table.factor != "") & (table.output != _PRESSURE)]
    for output, group in others.groupby("output"):
        largest = group.sort_values("change", key=abs, ascending=False).head(5)
        shown = largest[["factor", "value", "change"]].to_string(index=False)
        print(f"{output}:", shown, sep="\n")


if __name__ == "__main__":
    main()
