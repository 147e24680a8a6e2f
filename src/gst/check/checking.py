"""Checks a study without running it, and says what a run would do: `gst check`."""

import logging
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from gst.check.epochs import epochs_on_each_other
from gst.check.fixing import Cure, cures_of
from gst.check.inputs import Asked, Inputs, check_inputs
from gst.config.contradictions import counterface_mesh, improbable
from gst.config.named_files import check_files
from gst.config.patches import overlaps, scan_files
from gst.config.poses import poses_of, reach_of
from gst.config.reading import asked_of_files, read_config, read_study
from gst.run.chain import break_in, check_links
from gst.run.owned import claim_picture
from gst.run.provenance import refuse_other_study
from gstlib.conditions import load_force, load_point, study_modulus
from gstlib.coupling.placement import AGREES, ALL, CANNOT_TELL, shows_waves
from gstlib.coupling.pressures import patch_pressures
from gstlib.errors import NOTE, GstError, InputsError, unaccepted
from gstlib.io.files import check_writable
from gstlib.io.meshes import steps_of
from gstlib.macroscale.plausibility import plausibility_warnings
from gstlib.macroscale.sampling_sites import CONTROL, COUNTS, EXPOSED
from gstlib.preprocess.scans import mould_of, prepare_scan
from gstlib.study import Study
from gstlib.surfaces.footprints import square_of
from gstlib.surfaces.grid import coarser

if TYPE_CHECKING:
    from gst.page.figures.tool import PressedFace

__all__ = ["check_study"]

_log = logging.getLogger(__name__)

_SPOT = 2  # points of a coarse scan that make a loss or a gain


def _at_rest(study: Study) -> dict[str, str]:
    """Where the mesh alone comes to rest, in a line; its doubts are logged."""
    contact, size_mm = study.contact, study.config["square"]["size_mm"]
    for doubt in plausibility_warnings(contact, size_mm=size_mm):
        _log.warning("%s", doubt)
    patch_mm = study.config["scans"]["size_mm"]
    pressed = patch_pressures(contact.pressure, study.patches, size_mm=patch_mm)
    if len(pressed) and not (pressed.pressure_MPa > 0).any():
        _log.warning(
            "of the mesh alone, no patch is touched: there may be nothing to compare with wear; "
            "correct load.at_mm, load.force_N or counterface.radius_mm if it was used otherwise"
        )
    plane, inside = contact.interface.plane, square_of(contact.pressure, size_mm)
    tilt = 1e3 * float(np.hypot(plane.slope_y, plane.slope_x))
    share = float(inside.sum() / contact.pressure.sum())
    touched = 100 * float((inside > 0).mean())
    said = (
        f"of the mesh alone: tilted by {tilt:.2g} mrad against the square's mean plane; "
        f"{100 * share:.0f} % of the force lies in the square, and touches {touched:.2g} % of it"
    )
    return {"at rest": said}


def _placement(study: Study) -> dict[str, str]:
    """How many patches clearly fit the mesh under them, if it shows such short waves."""
    patch_mm = study.config["scans"]["size_mm"]
    if study.patches.empty or not shows_waves(study.face.height, patch_mm):
        return {}
    status = study.placement.status[study.placement.patch != ALL]
    if (status == CANNOT_TELL).all():
        mean = study.placement.correlation.iloc[-1]
        return {
            "placement": f"not certain: patches and mesh correlate by {mean:.2f} on average"
        }
    fitting, unclear = (status == AGREES).sum(), (status == CANNOT_TELL).sum()
    rest = f"; of {unclear} it cannot tell" if unclear else ""
    return {"placement": f"{fitting} of {len(status)} patches clearly fit the mesh{rest}"}


def _summary(
    config: dict,
    patches: pd.DataFrame,
    found: Inputs | None,
    poses: pd.DataFrame | None,
    said: dict[str, str],
) -> str:
    """What a run would do, and the sizes, which show whether units were read as intended."""
    macroscale, material = config["macroscale"], config["material"]
    size_mm, modulus = config["square"]["size_mm"], study_modulus(material)
    given, force_N = material["contact_modulus_MPa"], load_force(config["load"], size_mm)
    lines = {
        "stone": config["inputs"]["mesh"] if config["inputs"] else "to be generated",
        "macroscale": _pressed(config),
        "load": f"{force_N:.4g} N, {force_N / size_mm**2:.4g} MPa on the square, in "
        f"{macroscale['steps']} steps",
        "stiffness": f"E* = {modulus:.5g} MPa, "
        + ("from the elastic constants" if given is None else "as given"),
        "patches": _patches(config, patches),
        "results in": f"{config['results']}: {_state(config)}",
    }
    if poses is not None:
        lines["gesture"] = (
            f"{len(poses)} poses, which slide by {poses.sliding_mm.sum():.4g} mm in all"
        )
    if layer := config["interlayer"]:
        lines["interlayer"] = (
            f"{layer['thickness_um']:g} µm of {layer['young_MPa']:g} MPa, in turns with the bare "
            "stone"
        )
    if found is not None and found.stone is not None:
        size = " × ".join(f"{extent:.4g}" for extent in found.stone.extents)
        edge = found.stone.edges_unique_length.mean()
        lines["mesh"] = (
            f"{size} mm along its x, y, z; mean edge length {edge:.3g} mm; "
            f"coordinates in {steps_of(found.stone)}"
        )
    if found is not None and len(found.scans):
        scans = found.scans
        lines["scans"] = (
            f"up to {scans.points_x.max()} × {scans.points_y.max()} points; Sq "
            f"{_range(scans.Sq_um)} µm; height range {_range(scans.range_um)} µm; "
            f"{_range(100 * scans.unmeasured)} % unmeasured"
        )
    return f"{config['title']}\n" + "\n".join(
        f"  {name:<11} {text}" for name, text in (lines | said).items() if text
    )


def _state(config: dict) -> str:
    """Whether the results are those of this config and of the measured files as they are."""
    results = Path(config["results"])
    if not results.is_dir():
        return "not there yet"
    return break_in(results, config) or "finished, with this config and these files"


def _active_stone(
    config: dict, face: xr.Dataset | None, poses: pd.DataFrame | None
) -> "PressedFace | None":
    """For the picture: the two tools over the face, where one is pushed, and what is between."""
    from gst.page.figures.tool import PressedFace

    if face is None or config["coupling"] == "levelled":
        return None
    through = np.array(load_point(config["load"], config["square"]["size_mm"]))
    moved = np.zeros((1, 2)) if poses is None else poses[["y_mm", "x_mm"]].to_numpy()
    interlayer_um = config["interlayer"]["thickness_um"] if config["interlayer"] else None
    return PressedFace(face, through + moved, interlayer_um)


def _patches(config: dict, patches: pd.DataFrame) -> str:
    """How many patches are solved; or, without any, what the study proposes."""
    size_mm = config["scans"]["size_mm"]
    graded = patches.wear_grade.dropna()
    if len(graded) and not (patches.t0 != "").any():
        return (
            f"{len(graded)} places of {size_mm:g} mm with grades of wear from {graded.min():g} to "
            f"{graded.max():g}, and no scans"
        )
    if config["patches"] is not None:
        repeats = (patches["repeat"] != "").sum()
        return (
            f"{len(patches)} of {size_mm:g} mm, {config['microscale']['steps']} steps each; "
            f"{(patches.t1 != '').sum()} with a scan after use"
            + (f", {repeats} scanned twice without use" if repeats else "")
        )
    return (
        f"none yet: the face alone is pressed in the poses of the gesture, and {COUNTS[EXPOSED]} "
        f"places of {size_mm:g} mm are proposed for scanning, with {COUNTS[CONTROL]} controls that "
        "no pose touches"
    )


def _pressed(config: dict) -> str:
    """What is pressed on what."""
    size_mm, macroscale = config["square"]["size_mm"], config["macroscale"]
    element_um = 1e3 * size_mm / macroscale["grid"]
    square = f"{size_mm:g} mm square, elements of {element_um:g} µm"
    if config["coupling"] == "levelled":
        return f"{square}, alone on its mean plane, under a flat"
    y, x = load_point(config["load"], size_mm)
    form = config["counterface"] or {}
    radii = " and ".join(f"{of:g}" for of in np.ravel(form.get("radius_mm") or ()))
    other = f"a stone of {radii} mm radius" if radii else "a flat"
    if counterface_mesh(config, "") is not None:
        other = "an active tool"
    return (
        f"{square}, in a face of {macroscale['face_mm']:g} mm at rest under {other}; force "
        f"through x {x:g}, y {y:g} mm"
    )


def _range(values: Iterable[float]) -> str:
    low, high = (f"{value:.4g}" for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


class CoarseStudy(Study):
    """The study as far as a check has time: coarser scans, and the mesh alone on longer elements.

    `found` has a mesh and its face. Patches without a T0 are left out.
    """

    def __init__(self, config: dict, patches: pd.DataFrame, found: Inputs):
        assert found.stone is not None
        assert found.face is not None
        stone, there = found.stone, [(patch, "T0") in found.coarse for patch in patches.patch]
        super().__init__(
            # under the use that is stated: to read it from the wear takes longer than the rest
            config | {"traces": {"minimum_points": _SPOT}, "use": None},
            patches.loc[there],
            read_mesh=lambda: stone,
            read_scan=lambda *of: found.coarse[of],
        )
        self.face = found.face
        pressed = {name: coarser(self.face[name], 2) for name in ("height", "counterface")}
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


class _Count(logging.Handler):
    """Counts what is logged, by level."""

    def __init__(self) -> None:
        super().__init__(NOTE)
        self.number: Counter[int] = Counter()

    def emit(self, record: logging.LogRecord) -> None:
        self.number[record.levelno] += 1

    def __str__(self) -> str:
        """What there was, such as ``1 accepted fault, 2 warnings``."""
        names = {logging.ERROR: "accepted fault", logging.WARNING: "warning", NOTE: "note"}
        counts = [(self.number[level], name) for level, name in names.items()]
        return ", ".join(
            f"{count} {name}{'s' * (count > 1)}" for count, name in counts if count
        )


def check_study(path: Path, cures: list[Cure] | None = None) -> None:
    """Read config, patch table and every measured file of a study, and print what a run would do.

    If mesh and square can be read, ``check.png`` in the results folder shows them. `cures` takes
    those of what is found; None if they are not asked for. The `GstError` that it raises lists
    everything that is wrong.
    """
    logging.basicConfig(format="%(levelname)s: %(message)s", level=NOTE)
    logging.getLogger().addHandler(said_before := _Count())
    config = read_config(path)
    patches = read_study(config, str(path))
    unaccepted(improbable(config, patches), config["accept"])  # for it logs the accepted ones
    _warn_of_overlaps(config, patches)
    problems: list[GstError] = []
    writable, reach, poses, found = False, None, None, None
    with _noted(problems):
        check_writable(config["results"])
        check_links(Path(config["results"]))
        writable = True
        refuse_other_study(config)
    with _noted(problems):  # of the table of poses
        reach, poses = reach_of(config), poses_of(config)
    if config["inputs"] is not None:
        with _noted(problems):
            check_files(
                config, patches, ", ".join(filter(None, [str(path), config["patches"]]))
            )
        found = _read(config, patches, reach)
        problems += found.problems
    said: dict[str, str] = {}
    if found is not None and found.face is not None and not found.problems:
        study = CoarseStudy(config, patches, found)
        if not problems:
            others, said["T1 on T0"] = epochs_on_each_other(study)
            problems += unaccepted(others, config["accept"])
        for part in (_placement, _at_rest):
            with _noted(problems):
                said |= part(study)
        if cures is not None:
            cures += cures_of(study)
    print(f"{path}: {_summary(config, patches, found, poses, said)}")
    if writable and found is not None and found.frame is not None:
        if (picture := claim_picture(Path(config["results"]))) is None:
            said_of_it = "none: move your own check.png from the results first"
        else:
            _draw(picture, config, patches, found, poses)
            said_of_it = f"{picture}: the square on the stone, and the patches in it"
        print(f"  {'picture':<11} {said_of_it}")
    if problems:
        print(flush=True)
        raise InputsError(problems)
    print(f"\nNo problems found{f', but {said_before}: see above' * bool(said_before.number)}.")


@contextmanager
def _noted(problems: list[GstError]) -> Iterator[None]:
    """What is refused is noted, so that all can be corrected at once."""
    try:
        yield
    except GstError as error:
        problems.append(error)


def _warn_of_overlaps(config: dict, patches: pd.DataFrame) -> None:
    for one, other, share in overlaps(patches, config["scans"]["size_mm"]):
        _log.warning(
            "%s: patches %s and %s have %.2g %% of their area in common, whose wear counts twice; "
            "if they lie side by side, correct x_mm and y_mm",
            config["patches"],
            one,
            other,
            100 * share,
        )


def _read(config: dict, patches: pd.DataFrame, reach: float | None) -> Inputs:
    """The contents of the files that are there."""
    second = counterface_mesh(config, "")
    if second is not None:
        is_whole = reach is not None and Path(second["mesh"]).is_file()
        second = second | {"reach_mm": reach} if is_whole else None
    mesh, folder = Path(config["inputs"]["mesh"]), config["inputs"]["scan_folder"]
    scans = scan_files(patches, folder, (config["counterface"] or {}).get("scan"))
    asked = Asked(**asked_of_files(config, config["inputs"]["mesh_unit"], second))
    there = [scan for scan in scans if scan.path.is_file()]
    return check_inputs(mesh if mesh.is_file() else None, there, asked)


def _draw(
    picture: Path,
    config: dict,
    patches: pd.DataFrame,
    found: Inputs,
    poses: pd.DataFrame | None,
) -> None:
    """Draw the square on the stone, and the patches in it."""
    from gst.page.figures.style import save_figure
    from gst.page.figures.tool import check_figure

    size_mm = config["square"]["size_mm"]
    figure = check_figure(
        found.stone,
        found.frame,
        found.face and square_of(found.face.height, size_mm),
        patches,
        size_mm=size_mm,
        patch_size_mm=config["scans"]["size_mm"],
        pressed=_active_stone(config, found.face, poses),
    )
    save_figure(figure, picture)
