"""The method: all stages of the study, in the order of the paper.

It follows section 2 of Marulli, Sorrentino & Paggi (2024, J. Archaeol. Sci. Rep. 104939) and
continues beyond the paper. Each stage is a folder beside this file, and imports only from earlier
stages.

1. `preprocess`: the use-face of the tool's mesh becomes heights on a grid (`mesh.grid_mesh`). Scans
   are cleaned, filled and levelled (`scans.prepare_patch`).
2. `macroscale`: the face consists of the square and its surroundings (`face.grid_macroscale`). The
   scans are positioned on it (`composite.compose_surface`). The force of use presses a rounded
   active tool, or a second mesh with a pose (`active_tool`), on it. Both come to equilibrium
   (`gstlib.contact.contact_path`). The load point may scatter, and the tool may move
   (`gesture.press_poses`).
3. `coupling`: each scanned patch carries the macroscale forces in its outline
   (`pressures.couple_scales`), with an interval of its pressure (`intervals.pressure_intervals`).
   `placement.check_placement` checks the positions of the patches.
4. `microscale`: each patch, as it lies on the stone, is pressed at the scan's resolution up to its
   own pressure (`patches.solve_patches`). Stick and slip and a cap on the pressure are further
   cases (`slip_and_cap`).
5. `change`: T1 is registered to T0, which gives the height lost in use (`change.register_patch`).
   The texture is measured before and after use (`texture.measure_texture`).
   `selection.select_patches` selects the patches of the study.
6. `wear`: the square and its patches wear by Archard's law (`fit.fit_wear`). The loss of a patch is
   predicted from the losses of the others (`fit.predict_wear`).
7. `validation`: the predicted loss is scored against the measured loss, beside baselines with the
   same data (`summary.score_wear`).

The coupling has two variants. In `PAPER`, the square is cut out of the mesh and pressed flat on its
mean plane up to a mean pressure. A patch is pressed as its scan was levelled. In `EQUILIBRIUM`, the
forces on the stone balance, and the scans are part of its face. A patch keeps its plane in the
stone and yields to the pressures around it. Both are compared with one contact of the whole square
in its face, at the scans' resolution (`validation.single_scale.solve_reference`).

The functions take and return datasets and tables. The scripts of the workflow, one per stage, read
and write the files. `Study` runs the same stages in memory, for sweeps over settings and for many
synthetic specimens.

Lengths are in mm and pressures in MPa unless a name indicates otherwise. These words have the same
meaning everywhere:

- A *surface* is heights on a grid, an array (y, x) in mm (`gstlib.surfaces.grid`).
- The *face* is the dataset of `gstlib.macroscale.face.grid_macroscale`, the square and its
  surroundings. The *counterface* is the surface that is pressed on it.
- *patches* is the patch table, and *pressures* is that table with the pressure of each patch.
- *scans*, *contacts* and *changes* are prepared scans, contacts and height changes, each a dataset,
  by patch. Such a mapping may read them on access (`gstlib.io.store.Stored`).
- A *contact* is the state of two faces at one load (`gstlib.contact`).
"""

from collections.abc import Callable, Hashable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import pandas as pd
import xarray as xr

from gstlib.change.change import (
    SCAN_FIELDS,
    Detection,
    estimate_detection_limit,
    register_patch,
)
from gstlib.change.selection import registration_table, select_patches
from gstlib.conditions import rounded_form
from gstlib.contact import Contact
from gstlib.coupling.placement import check_placement
from gstlib.coupling.pressures import couple_scales, covered_pressures
from gstlib.errors import InputError, accepting, concerning
from gstlib.macroscale.active_tool import ActiveTool, RoundedTool
from gstlib.macroscale.composite import compose_surface
from gstlib.macroscale.equilibrium import solve_at_load
from gstlib.macroscale.face import grid_macroscale
from gstlib.microscale.patches import PAPER, Microscale, solve_patches
from gstlib.preprocess.scans import crop_of, prepare_patch
from gstlib.settings import Settings
from gstlib.use.outcome import as_used, pressures_of_use, use_of_study
from gstlib.validation.summary import score_wear
from gstlib.wear.archard import WornSquare
from gstlib.wear.fit import Prediction, fit_wear, predict_wear

if TYPE_CHECKING:
    import trimesh

__all__ = ["Study"]


class _Stage(dict):
    """Results of a stage by patch, each computed on first access."""

    def __init__(self, compute: Callable[[Any], Any]):
        super().__init__()
        self._compute = compute

    def __missing__(self, key: Hashable) -> Any:
        self[key] = result = self._compute(key)
        return result


class Study:
    """A study in memory: each stage is computed on first access, and kept.

    A stage is an attribute or a mapping: `prepared`, the clean scans, by patch and epoch; height
    `changes` and `contacts` by patch. Assign a value to replace it: ``study.composite = surface``,
    ``study.contacts["5"] = contact``. Contacts are solved at the load alone, without the path to
    it.

    Parameters
    ----------
    settings : Settings or mapping
        Settings of the study, or the keys of its config, all optional. Invalid ones raise a
        `pydantic.ValidationError`.
    patches : pandas.DataFrame
        The patch table: ``patch, x_mm, y_mm`` and optionally ``rotation_deg, t1, repeat, flip,
        crop_x_mm, crop_y_mm``. ``t1`` is empty or NaN if there is none. Names become text.
    read_mesh, read_scan, read_face : callable
        Functions that return the mesh of the stone, mm; the raw scan (y, x) of a patch at an epoch
        or a repeat, such as ``("5", "T0")``; and the scan of the active tool, if there is one.
    active_tool : ActiveTool, optional
        By default, the active tool is flat or rounded, as in the config.

    Examples
    --------
    The upper side of a block, before anything is scanned, under a handstone of 100 mm:

    >>> import gstlib, trimesh
    >>> block = trimesh.creation.box((4, 4, 3))
    >>> for _ in range(4):
    ...     block = block.subdivide()
    >>> points_mm = [[1.0, 1.0, 1.5], [-1.0, 1.0, 1.5], [1.0, -1.0, 1.5]]
    >>> study = gstlib.Study(
    ...     {
    ...         "square": {"size_mm": 2.0, "points_mm": points_mm},
    ...         "macroscale": {"grid": 16, "face_mm": 3.0},
    ...         "load": {"force_N": 50.0},
    ...         "counterface": {"radius_mm": 100.0},
    ...     },
    ...     pd.DataFrame({"patch": []}),
    ...     read_mesh=lambda: block,
    ...     read_scan=lambda patch, epoch: None,
    ... )
    >>> round(float(study.contact.pressure.max()), 1)  # MPa
    46.7
    """

    def __init__(
        self,
        settings: Settings | Mapping[str, Any],
        patches: pd.DataFrame,
        *,
        read_mesh: Callable[[], "trimesh.Trimesh"],
        read_scan: Callable[[str, str], xr.DataArray],
        read_face: Callable[[], xr.DataArray] | None = None,
        active_tool: ActiveTool | None = None,
    ):
        if not isinstance(settings, Settings):
            settings = Settings(**settings)
        self.config = settings.model_dump()
        self.settings = settings.by_stage()
        self.patches, self.active_tool = _as_read(patches), active_tool
        self.read_mesh, self.read_scan, self.read_face = read_mesh, read_scan, read_face
        self.worn = self.patches.patch[self.patches.t1 != ""].tolist()
        self.prepared = _Stage(lambda scan: self.prepare(*scan))
        self.changes = _Stage(self._register)
        self.contacts = _Stage(lambda patch: self.contact_in(settings.coupling, patch))
        self._before = _Stage(lambda patch: self.prepared[patch, "T0"])

    @cached_property
    def face(self) -> xr.Dataset:
        """The face, from `grid_macroscale`; in the paper, the square under a flat."""
        tool = self.active_tool or RoundedTool(*rounded_form(self.config))
        settings = self.settings["grid_macroscale"]
        with accepting(self.config["accept"]):
            return grid_macroscale(self.read_mesh(), active_tool=tool, **settings)[0]

    @cached_property
    def composite(self) -> xr.Dataset:
        """The face with the scans, from `compose_surface`, or the face alone."""
        if self.config["coupling"] == PAPER or self.patches.empty:
            return self.face
        settings = self.settings["compose_surface"]
        return compose_surface(self.face, self.patches, self._before, **settings)

    @cached_property
    def use(self) -> xr.Dataset | None:
        """The inferred load case, from `use_of_study`; None if nothing is inferred."""
        config = self.config
        if config["use"] is None or config["coupling"] == PAPER or not self.worn:
            return None
        stages = self.composite, self.patches, self.registration
        return use_of_study(*stages, **self.settings["infer_use"])[0]

    @cached_property
    def contact(self) -> Contact:
        """Contact of the stone in equilibrium under its load; in the paper, of the square alone."""
        settings = dict(self.settings["solve_macroscale"])
        face, settings["load_point"] = as_used(
            self.composite, self.use, settings["load_point"]
        )
        return solve_at_load(face, **settings)

    @cached_property
    def square_contact(self) -> Contact:
        """Contact of the square alone, on its mean plane."""
        if self.config["coupling"] == PAPER:
            return self.contact
        return solve_at_load(self.face, **self.settings["solve_square"])

    @cached_property
    def pressures(self) -> pd.DataFrame:
        """Pressure of every patch, from `couple_scales`."""
        fields = self.contact.pressure, self.square_contact.pressure
        table = couple_scales(*fields, self.patches, **self.settings["couple_scales"])
        return pressures_of_use(table, self.use, **self.settings["couple_scales"])

    @cached_property
    def placement(self) -> pd.DataFrame:
        """Check of the positions in the patch table, from `check_placement`."""
        settings = self.settings["check_placement"]
        return check_placement(self.face.height, self.patches, self._before, **settings)

    @cached_property
    def counterface(self) -> xr.DataArray | None:
        """The clean scan of the active tool's own face."""
        if self.read_face is None:
            return None
        return prepare_patch(
            self.read_face(), crop=None, **self.settings["prepare_scans"]
        ).height

    @cached_property
    def detection(self) -> Detection | None:
        """The error of a height change, from `estimate_detection_limit`; None without repeats."""
        twice = self.patches.patch[self.patches["repeat"] != ""]
        again = {patch: self.prepared[patch, "repeat"] for patch in twice}
        return estimate_detection_limit(
            self._before, again, **self.settings["register_patches"]
        )

    @cached_property
    def registration(self) -> pd.DataFrame:
        """Quality of each registration, and the losses, from `registration_table`."""
        changes = {patch: self.changes[patch] for patch in self.worn}
        return registration_table(changes, **self.settings["select_patches"])

    @cached_property
    def selected(self) -> pd.DataFrame:
        """Every patch with its pressures and whether it is in the study, from `select_patches`."""
        stages = self.pressures, self.contact.pressure, self.registration
        pressures = covered_pressures(*stages, **self.settings["couple_scales"])
        return select_patches(pressures, self.registration, self.config["selection"])

    @cached_property
    def worn_square(self) -> WornSquare | None:
        """The worn square, from `fit_wear`."""
        stages = self.contact, self.selected, self.registration
        maps = self.contacts, self.changes
        return fit_wear(*stages, *maps, **self.settings["fit_wear"])

    def prepare(self, patch: str, epoch: str) -> xr.Dataset:
        """A clean scan, from `prepare_patch`."""
        row = self.patches.set_index("patch").loc[patch]
        cut = {"epoch": epoch, "crop": crop_of(row), "flip": row["flip"]}
        settings = self.settings["prepare_scans"]
        with accepting(self.config["accept"]), concerning([patch]):
            scan = self.read_scan(patch, epoch)
        prepared = prepare_patch(scan, **cut, **settings)
        return prepared[SCAN_FIELDS]

    def contact_in(self, variant: str, patch: str) -> Contact:
        """Contact of a patch at its own pressure in a variant of the coupling."""
        settings = self.settings["solve_patches"] | {"steps": None}
        ((_, _, contact),) = solve_patches(
            {patch: self.prepared[patch, "T0"]},
            self.pressures,
            Microscale(**settings),
            variants=[variant],
            composite=self.composite,
            contact=self.contact,
            counterface=self.counterface,
        )
        assert isinstance(contact, Contact)  # without steps there is no path
        return contact

    def scored(self, **drawn: Any) -> dict[str, pd.DataFrame]:
        """The tables of `score_wear`, for the losses from `predict_wear`.

        ``seed`` and ``resamples`` may differ from the config.
        """
        contacts = {patch: self.contacts[patch] for patch in self.worn}
        changes = {patch: self.changes[patch] for patch in self.worn}
        depths = dict(
            predict_wear(contacts, self.worn_square, **self.settings["predict_wear"])
        )
        prediction = Prediction.from_worn(depths, self.worn_square)
        settings = self.settings["score_wear"] | drawn
        return score_wear(
            contacts, changes, prediction, self.selected, self.registration, **settings
        )

    def _register(self, patch: str) -> xr.Dataset:
        """Height change of a patch, from `register_patch`."""
        scans = self.prepared[patch, "T0"], self.prepared[patch, "T1"]
        settings = self.settings["register_patches"] | {"detection": self.detection}
        return register_patch(*scans, patch=patch, **settings)


def _as_read(patches: pd.DataFrame) -> pd.DataFrame:
    """The patch table as a config's: names and files are text, and absent columns are empty."""
    if patches.empty:
        patches = patches.reindex(columns=["patch", "x_mm", "y_mm"])
    texts = patches.reindex(columns=["t1", "repeat", "flip"]).astype(object).fillna("")
    turns = patches.reindex(columns=["rotation_deg"]).fillna(0.0)
    names = patches.patch.astype(str)
    if (twice := names[names.duplicated()]).size:
        problem = f"patch {twice.iloc[0]} is there twice"
        raise InputError("patches", problem, "Give each patch one row.")
    return patches.assign(patch=names, **texts, **turns)
