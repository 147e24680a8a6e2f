"""A study's results as an RO-Crate: one archive that says what is in it and where it comes from.

Follows RO-Crate and its profile for runs, Process Run Crate (w3id.org/ro/wfrun/process): an action,
the study, made the tables and figures from inputs, with a program and settings. What is known of
these stands in the study's ``provenance.json``.
"""

import json
from pathlib import Path

from gstlib.errors import InputError
from gstlib.io.tables import read_table

__all__ = ["read_record", "write_crate"]

_PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
# Folders and files of the results that a reader wants; the fields (HDF5) are large.
_PARTS = {
    "report.html": "The report",
    "provenance.json": "Settings, inputs' hashes and versions",
    "tables/*.csv": "Table",
    "figures/**/*.png": "Figure",
}
# What every finished study has (the report is made last), what one has with patches in the
# microscale study, and what one has if any of these was scanned after use.
_FINISHED = [
    "report.html",
    "tables/inputs.csv",
    "tables/preprocessing.csv",
    "tables/outliers.csv",
    "tables/gridding.csv",
    "tables/macroscale_path.csv",
    "tables/placement.csv",
    "tables/patch_pressures.csv",
    "tables/patch_intervals.csv",
    "tables/texture.csv",
]
_STUDIED = ["tables/microscale_summary.csv", "figures/overview.png"]
_SCORED = [
    "tables/validation_patches.csv",
    "tables/validation_summary.csv",
    "figures/validation.png",
]
_FORMATS = {
    ".csv": "text/csv",
    ".html": "text/html",
    ".json": "application/json",
    ".png": "image/png",
}


def write_crate(results: str | Path, target: str | Path) -> int:
    """Pack tables, figures and report of a finished study, with where they come from.

    Parameters
    ----------
    results : path
        Folder of the config's key ``results``.
    target : path
        The archive to write, ``.zip``.

    Returns
    -------
    int
        How many files are in it.

    Raises
    ------
    InputError
        There is no finished study in `results` (something that every study has is missing), or
        `target` is no ``.zip``.
    """
    from rocrate.model.contextentity import ContextEntity
    from rocrate.rocrate import ROCrate

    results, target = Path(results), Path(target)
    if target.suffix != ".zip":
        raise InputError(target, "is no .zip", "Name the archive to write, such as study.zip.")
    record = read_record(results)
    software = record["software"]
    _check_finished(results)

    def described(number: str, **properties) -> ContextEntity:
        return crate.add(ContextEntity(crate, f"#{number}", properties=properties))

    crate = ROCrate()
    crate.name = record["config"]["title"]
    crate.description = (
        f"Predicted and measured wear of a ground stone tool ({crate.name}): tables, figures and "
        "report of a study with gstlib"
    )
    profile = {"@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"}
    crate.root_dataset["conformsTo"] = crate.add(ContextEntity(crate, _PROFILE, properties=profile))
    program = described(
        "gstlib",
        **{"@type": "SoftwareApplication", "name": "gstlib", "softwareVersion": software["gstlib"]},
        identifier=software["commit"] or "",
        softwareRequirements=[
            f"Python {software['python']}",
            *(f"{name} {version}" for name, version in software["packages"].items()),
        ],
    )
    inputs = [
        described(f"input-{place}", **{"@type": "CreativeWork", "name": name, "sha256": sha256})
        for place, (name, sha256) in enumerate(record["inputs"].items(), 1)
    ]
    settings = [
        described(
            f"setting-{name}",
            **{"@type": "PropertyValue", "name": name, "value": json.dumps(value)},
        )
        for name, value in record["config"].items()
    ]
    files = [
        crate.add_file(
            file,
            file.relative_to(results).as_posix(),
            properties={
                "name": f"{what}: {file.stem}" if "*" in pattern else what,
                "encodingFormat": _FORMATS[file.suffix],
            },
        )
        for pattern, what in _PARTS.items()
        for file in sorted(results.glob(pattern))
    ]
    crate.root_dataset["mentions"] = described(
        "study",
        **{"@type": "CreateAction", "name": "The study", "instrument": program},
        object=inputs + settings,
        result=files,
    )
    target.parent.mkdir(parents=True, exist_ok=True)
    crate.write_zip(target)
    return len(files)


def _check_finished(results: Path) -> None:
    """InputError if the study in `results` has not run to its end."""
    wanted = list(_FINISHED)
    pressures, registration = (
        results / f"tables/{name}.csv" for name in ("patch_pressures", "registration")
    )
    if pressures.is_file():
        table = read_table(pressures, ["patch", "in_study"])
        studied = set(table.patch[table.in_study])
        wanted += _STUDIED if studied else []
        if registration.is_file() and studied & set(read_table(registration, ["patch"]).patch):
            wanted += _SCORED
    missing = [name for name in wanted if not (results / name).is_file()]
    if missing:
        raise InputError(
            results,
            f"holds no finished study: {', '.join(missing)} missing",
            "Run `make study` with its config to the end, then pack it.",
        )


def read_record(results: Path) -> dict:
    """The `provenance.json` of a results folder; InputError if there is none."""
    file = results / "provenance.json"
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            file, f"cannot be read ({error})", "Name the results folder of a finished study."
        ) from error
