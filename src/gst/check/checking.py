"""Checks a study without running it, and describes a run (`gst check`).

The check is one walk: settings, tables, files, contact, answer. Each station notes the faults that
it finds, and what it read for the later ones; warnings and notes are logged at once.
"""

import logging
from collections import Counter
from dataclasses import dataclass, field
from logging.handlers import BufferingHandler
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from gst.check.answer import draw, summary
from gst.check.epochs import epochs_on_each_other
from gst.check.fixing import Cure, cures_of
from gst.check.inputs import Asked, Inputs, check_inputs, noting
from gst.config.contradictions import check_files, counterface_mesh, improbable
from gst.config.patches import overlaps, scan_files
from gst.config.poses import poses_of, reach_of
from gst.config.reading import asked_of_files, read_config, read_study
from gst.run.chain import check_links
from gst.run.owned import claim_picture
from gst.run.provenance import refuse_other_study
from gstlib.coupling.comparison import AGREES, CANNOT_TELL, shows_waves
from gstlib.coupling.pressures import patch_pressures
from gstlib.errors import NOTE, GstError, InputsError, unaccepted
from gstlib.io.files import check_writable
from gstlib.macroscale.plausibility import plausibility_warnings
from gstlib.preprocess.scans import mould_of, prepare_scan
from gstlib.study import Study
from gstlib.surfaces.footprints import square_of
from gstlib.surfaces.grid import coarser

_log = logging.getLogger(__name__)

_SPOT = 2  # points of a coarse scan that make a loss or a gain
_LEVELS = {logging.ERROR: "accepted fault", logging.WARNING: "warning", NOTE: "note"}


def check_study(path: Path, cures: list[Cure] | None = None) -> None:
    """Read config, patch table and every measured file of a study, and describe a run.

    If mesh and square can be read, ``check.png`` in the results folder shows them. `cures` takes
    those of the faults; None if they are not asked for. The `GstError` that it raises lists
    everything that is wrong.
    """
    logging.basicConfig(format="%(levelname)s: %(message)s", level=NOTE)
    remarks = BufferingHandler(1 << 20)
    remarks.setLevel(NOTE)
    logging.getLogger().addHandler(remarks)
    Walk(path, cures).run()
    count = Counter(record.levelno for record in remarks.buffer)
    logged = ", ".join(
        f"{count[level]} {name}{'s' * (count[level] > 1)}"
        for level, name in _LEVELS.items()
        if count[level]
    )
    print(f"\nNo problems found{f', but {logged}: see above' * bool(logged)}.")


@dataclass
class Walk:
    """A check, with everything that its stations have read so far.

    `cures` is that of `check_study`.
    """

    path: Path
    cures: list[Cure] | None
    faults: list[GstError] = field(default_factory=list)
    config: dict = field(default_factory=dict)
    patches: pd.DataFrame = field(default_factory=pd.DataFrame)
    is_writable: bool = False
    # of the active tool's face; None if the poses cannot be read
    reach_mm: float | None = None
    poses: pd.DataFrame | None = None
    inputs: Inputs | None = None  # None of a specimen that is to be generated
    # of the answer, about the contact
    lines: dict[str, str] = field(default_factory=dict)

    def run(self) -> None:
        """Go through all stations, and describe a run. An error lists all faults."""
        for station in (self.settings, self.tables, self.files, self.contact):
            station()
        self.answer()

    def settings(self) -> None:
        """The config, and the folder of its results; a config that cannot be used ends the walk."""
        self.config = config = read_config(self.path)
        self.patches = read_study(config, str(self.path))
        with noting(self.faults):
            check_writable(config["results"])
            check_links(Path(config["results"]))
            self.is_writable = True
            refuse_other_study(config)

    def tables(self) -> None:
        """The patch table, which `settings` could read, and the table of poses."""
        config = self.config
        # logs the accepted ones
        unaccepted(improbable(config, self.patches), config["accept"])
        for one, other, share in overlaps(self.patches, config["scans"]["size_mm"]):
            message = (
                "%s: patches %s and %s have %.2g %% of their area in common, whose wear counts "
                "twice. If they lie side by side, correct x_mm and y_mm."
            )
            _log.warning(message, config["patches"], one, other, 100 * share)
        with noting(self.faults):
            self.poses = poses_of(config)
            self.reach_mm = reach_of(config, self.poses)

    def files(self) -> None:
        """The mesh and every scan; those that are there are read, whatever else is missing."""
        config, patches = self.config, self.patches
        if (named := config["inputs"]) is None:
            return
        with noting(self.faults):
            check_files(config, patches, str(self.path))
        tool = counterface_mesh(config, "")
        if tool is not None:
            is_whole = self.reach_mm is not None and Path(tool["mesh"]).is_file()
            tool = tool | {"reach_mm": self.reach_mm} if is_whole else None
        mesh, counterface = Path(named["mesh"]), config["counterface"] or {}
        scans = scan_files(patches, named["scan_folder"], counterface.get("scan"))
        self.inputs = check_inputs(
            mesh if mesh.is_file() else None,
            [scan for scan in scans if scan.path.is_file()],
            Asked(**asked_of_files(config, named["mesh_unit"], tool)),
        )
        self.faults += self.inputs.problems

    def contact(self) -> None:
        """T1 on T0, the patches on the mesh, and the mesh at rest, on coarse grids."""
        inputs = self.inputs
        if inputs is None or inputs.face is None or inputs.problems:
            return
        study = CoarseStudy(self.config, self.patches, inputs)
        if not self.faults:
            unlike, self.lines["T1 on T0"] = epochs_on_each_other(study)
            self.faults += unaccepted(unlike, self.config["accept"])
        for part in (study.fit, study.at_rest):
            with noting(self.faults):
                self.lines |= part()
        if self.cures is not None:
            self.cures += cures_of(study)

    def answer(self) -> None:
        """Describe a run, and draw the square. An `InputsError` lists all faults."""
        config, inputs = self.config, self.inputs
        print(f"{self.path}: {config['title']}")
        print(summary(config, self.patches, inputs, self.poses), end="")
        if self.is_writable and inputs is not None and inputs.frame is not None:
            line = "none: move your own check.png from the results first"
            if picture := claim_picture(Path(config["results"])):
                draw(picture, config, self.patches, inputs, self.poses)
                line = f"{picture}: the square on the stone, and the patches in it"
            self.lines["picture"] = line
        for name, text in self.lines.items():
            if text:
                print(f"  {name:<11} {text}")
        if self.faults:
            print(flush=True)
            raise InputsError(self.faults)


class CoarseStudy(Study):
    """The study as far as a check has time: coarser scans, and the mesh alone on longer elements.

    `inputs` has a mesh and its face. Patches without a T0 are left out.
    """

    def __init__(self, config: dict, patches: pd.DataFrame, inputs: Inputs):
        assert inputs.stone is not None
        assert inputs.face is not None
        stone = inputs.stone
        has_t0 = [(patch, "T0") in inputs.coarse for patch in patches.patch]
        super().__init__(
            # under the use that is stated: to read it from the wear takes longer than the rest
            config | {"detection": {"minimum_cluster_points": _SPOT}, "use": None},
            patches.loc[has_t0],
            read_mesh=lambda: stone,
            read_scan=lambda *scan: inputs.coarse[scan],
        )
        self.face = inputs.face
        pressed = {
            name: coarser(self.face[name], 2) for name in ("height", "counterface")
        }
        self.composite = xr.Dataset(pressed | {"size_mm": self.face.size_mm})

    def prepare(self, patch: str, epoch: str) -> xr.Dataset:
        """A clean scan; how it is cut, and how much is unmeasured, was seen where it was read."""
        row = self.patches.set_index("patch").loc[patch]
        mould = mould_of(self.config["scans"]["mould"], row.flip)
        return prepare_scan(
            self.read_scan(patch, epoch),
            mould_invert=mould["invert"],
            mould_flip=mould["flip"],
            maximum_unmeasured=1.0,
        )

    def fit(self) -> dict[str, str]:
        """How many patches clearly fit the mesh under them, if it shows such short waves."""
        patch_mm = self.config["scans"]["size_mm"]
        if self.patches.empty or not shows_waves(self.face.height, patch_mm):
            return {}
        *status, _ = self.placement.status  # the last row is of all patches together
        unclear = status.count(CANNOT_TELL)
        if unclear == len(status):
            mean = self.placement.correlation.iloc[-1]
            line = f"not certain: patches and mesh correlate by {mean:.2f} on average"
        else:
            line = (
                f"{status.count(AGREES)} of {len(status)} patches clearly fit the mesh"
            )
            line += f"; of {unclear} it cannot tell" * bool(unclear)
        return {"placement": line}

    def at_rest(self) -> dict[str, str]:
        """Where the mesh alone comes to rest, in a line; its doubts are logged."""
        contact, size_mm = self.contact, self.config["square"]["size_mm"]
        doubts = list(plausibility_warnings(contact, size_mm=size_mm))
        patch_mm = self.config["scans"]["size_mm"]
        pressed = patch_pressures(contact.pressure, self.patches, size_mm=patch_mm)
        if len(pressed) and not (pressed.pressure_MPa > 0).any():
            doubts.append(
                "the mesh alone does not touch a patch, so wear may have nothing to be compared "
                "with. If load.at_mm, load.force_N or counterface.radius_mm is wrong, correct it"
            )
        for doubt in doubts:
            _log.warning("%s", doubt)
        plane, inside = contact.interface.plane, square_of(contact.pressure, size_mm)
        tilt = 1e3 * float(np.hypot(plane.slope_y, plane.slope_x))
        share = 100 * float(inside.sum() / contact.pressure.sum())
        touched = 100 * float((inside > 0).mean())
        line = (
            f"of the mesh alone: tilted by {tilt:.2g} mrad against the square's mean plane; "
            f"{share:.0f} % of the force lies in the square, and touches {touched:.2g} % of it"
        )
        return {"at rest": line}
