"""The method: all stages of the study, in the order of the paper, each in the room of its name.

It follows section 2 of Marulli, Sorrentino & Paggi (2024, J. Archaeol. Sci. Rep. 104939) and goes
on where the paper stops. A room is a folder beside this file; it imports only from rooms that come
before it.

1. `preprocess`: the use-face of the tool's mesh becomes heights on a grid (`mesh.grid_mesh`); scans
   are cleaned, filled and levelled (`scans.prepare_patch`).
2. `macroscale`: the face is the square and what is around it (`face.grid_macroscale`). The scans
   are laid on it where they were taken (`composite.compose_surface`). A rounded active tool, or a
   second mesh that was posed on it (`active_tool`), is pressed on the whole by the force of use,
   and both come to rest (`gstlib.contact.contact_path`); the load point scatters, and the stone
   moves (`gesture.press_poses`).
3. `coupling`: each scanned patch carries the macroscale forces in its outline
   (`pressures.couple_scales`): a pressure with an interval (`intervals.pressure_intervals`).
   `placement.place_patches` checks where the patches lie.
4. `microscale`: each patch, as it lies on the stone, is pressed at the scan's resolution up to its
   own pressure (`patches.solve_patches`). Stick and slip and a cap on the pressure are further
   cases (`slip_and_cap`).
5. `change`: T1 is registered to T0, which gives the height that use took away
   (`change.register_patch`), and the texture is measured before and after use
   (`texture.measure_texture`). `selection.select_patches` says which patches enter the study.
6. `wear`: the square and its patches wear by Archard's law (`fit.wear_stone`), which predicts the
   loss of a patch from those of the others (`fit.wear_map`).
7. `validation`: the predicted loss is scored by the measured one, beside baselines that are given
   the same data (`summary.score_wear`).

Two variants of the coupling exist. In the paper's, `LEVELLED`, the square is cut out of the mesh,
pressed flat on its mean plane up to a mean pressure, and a patch is pressed as its scan was
levelled. In `PLACED`, the stone lies where its forces balance, the scans enter its face, and a
patch keeps its plane in it and yields to the pressures around it. Both are held against one contact
of the whole square at the scans' resolution, which is placed in the face likewise
(`validation.single_scale.press_whole`).

The functions take and return datasets and tables, and read and write no file of results: the
workflow's scripts do, one stage each. `Study` runs the same stages in memory, for sweeps over
settings and for many synthetic specimens.

Lengths are in mm and pressures in MPa unless a name says otherwise. Words mean the same everywhere:

- a *surface* is heights on a grid, an array (y, x) in mm (`gstlib.surfaces.grid`);
- the *face* is the dataset of `gstlib.macroscale.face.grid_macroscale`, the square and what is
  around it; the *counterface* is what is pressed on it;
- *patches* is the patch table, *pressures* that table with the pressure of each patch;
- *scans*, *contacts* and *changes* are prepared scans, contacts and height changes, each a dataset,
  by patch; such a mapping may read them when they are looked up (`gstlib.io.store.Stored`);
- a *contact* is the state of two faces at one load (`gstlib.contact`).
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import pandas as pd
import xarray as xr

from gstlib.change.change import Detection, measure_detection, register_patch
from gstlib.change.selection import registration_table, select_patches
from gstlib.conditions import load_force, load_point, study_modulus
from gstlib.contact import Contact, Load, contact_at_pressure
from gstlib.coupling.pressures import couple_scales
from gstlib.macroscale.active_tool import ActiveTool, RoundedTool
from gstlib.macroscale.composite import compose_surface
from gstlib.macroscale.equilibrium import pressed_interface, solve_square
from gstlib.macroscale.face import grid_macroscale
from gstlib.microscale.patches import PLACED, Microscale, solve_patches
from gstlib.preprocess.scans import prepare_patch
from gstlib.validation.summary import score_wear
from gstlib.wear.archard import WornSquare
from gstlib.wear.fit import Prediction, wear_map, wear_stone
from gstlib.wear.interlayer import fit_interlayer

if TYPE_CHECKING:
    import trimesh

__all__ = ["Study"]


class _Stage(dict):
    """What a stage gives for each patch, computed when it is first looked up."""

    def __init__(self, compute: Callable[[Any], Any]):
        super().__init__()
        self._compute = compute

    def __missing__(self, key: Hashable) -> Any:
        self[key] = found = self._compute(key)
        return found


class Study:
    """A study in memory: each stage is computed when it is first asked for, and kept.

    A stage is an attribute, or a mapping by patch. To put something else in its place, assign it:
    ``study.composite = surface``, ``study.contacts["5"] = contact``. Contacts are solved at the
    load alone, without the path to it.

    Parameters
    ----------
    config : mapping
        Complete, with defaults.
    patches : pandas.DataFrame
        The patch table, with ``t1``, empty where there is none; ``repeat``, likewise, and
        ``flip`` may be missing.
    read_mesh : callable
        Gives the stone's mesh, mm.
    read_scan : callable
        Gives the raw scan (y, x) of a patch at an epoch, ``("5", "T0")``; a repeat is an epoch.
    read_face : callable, optional
        Gives the raw scan of the active tool's own face.
    active_tool : ActiveTool, optional
        By default the active tool is flat, or rounded as the config says.

    Attributes
    ----------
    prepared : mapping of (str, str) to xarray.Dataset
        Clean scans by patch and epoch.
    changes : mapping of str to xarray.Dataset
        Height changes, of patches with a T1.
    contacts : mapping of str to Contact
        Of patches at their own pressures, in the study's own variant of the coupling.
    """

    def __init__(
        self,
        config: Mapping[str, Any],
        patches: pd.DataFrame,
        *,
        read_mesh: Callable[[], "trimesh.Trimesh"],
        read_scan: Callable[[str, str], xr.DataArray],
        read_face: Callable[[], xr.DataArray] | None = None,
        active_tool: ActiveTool | None = None,
    ):
        self.config, self.patches = config, patches
        self.worn = patches.patch[patches.t1 != ""].tolist()
        twice = patches[patches["repeat"] != ""] if "repeat" in patches else patches[:0]
        self.repeated = twice.patch.tolist()
        self.read_mesh, self.read_scan, self.read_face = read_mesh, read_scan, read_face
        self.active_tool = active_tool
        self.is_placed = config["coupling"] == PLACED
        self.modulus = study_modulus(config["material"])
        self.patch_mm = config["scans"]["size_mm"]
        self._size_mm = config["square"]["size_mm"]
        self._solved = {"modulus": self.modulus, "tolerance": config["macroscale"]["tolerance"]}
        self._scanned_twice = config["registration"] | config["traces"]
        self.prepared = _Stage(self._prepare)
        self.changes = _Stage(self._register)
        self.contacts = _Stage(lambda patch: self.contact_in(config["coupling"], patch))

    @cached_property
    def face(self) -> xr.Dataset:
        """The face, from `grid_macroscale`; the paper's is the square, under a flat."""
        macroscale, form = self.config["macroscale"], self.config["counterface"] or {}
        settings = {name: macroscale[name] for name in ("grid", "interpolation")}
        if self.is_placed:
            rounded = RoundedTool(form.get("radius_mm"))
            settings["face_mm"] = macroscale["face_mm"]
            settings["active_tool"] = self.active_tool or rounded
        return grid_macroscale(self.read_mesh(), **self.config["square"], **settings)[0]

    @cached_property
    def composite(self) -> xr.Dataset:
        """The scans laid on the mesh's surface, from `compose_surface`."""
        return compose_surface(
            self.face,
            self.patches,
            {patch: self.prepared[patch, "T0"] for patch in self.patches.patch},
            patch_mm=self.patch_mm,
            s_filter_um=self.config["microscale"]["s_filter_um"],
            placement_um=self.config["uncertainty"]["placement_um"],
            seed=self.config["seed"],
        )

    @cached_property
    def contact(self) -> Contact:
        """Contact of the stone in equilibrium under its load; the paper's of the square alone."""
        if not self.is_placed:
            return self.square_contact
        through = load_point(self.config["load"], self._size_mm)
        interface = pressed_interface(self.composite, through)
        force_N = load_force(self.config["load"], self._size_mm)
        load = Load.of_force(force_N, interface.height, through)
        return contact_at_pressure(interface, load, source="macroscale", **self._solved)

    @cached_property
    def square_contact(self) -> Contact:
        """Contact of the square alone, from `solve_square`."""
        force_N = load_force(self.config["load"], self._size_mm)
        return solve_square(self.face, force_N=force_N, **self._solved)

    @cached_property
    def pressures(self) -> pd.DataFrame:
        """Pressure of every patch, from `couple_scales`."""
        fields = self.contact.pressure, self.square_contact.pressure
        return couple_scales(*fields, self.patches, patch_mm=self.patch_mm)

    @cached_property
    def counterface(self) -> xr.DataArray | None:
        """The clean scan of the active tool's own face."""
        return self._clean(self.read_face(), None).height if self.read_face else None

    @cached_property
    def detection(self) -> Detection | None:
        """The error of a height change, from `measure_detection`; None without repeats."""
        before, again = (
            {patch: self.prepared[patch, epoch] for patch in self.repeated}
            for epoch in ("T0", "repeat")
        )
        return measure_detection(before, again, **self._scanned_twice)

    @cached_property
    def registration(self) -> pd.DataFrame:
        """How well T1 matches T0, and what was lost, from `registration_table`."""
        changes = {patch: self.changes[patch] for patch in self.worn}
        max_noise_fraction = self.config["validation"]["max_noise_fraction"]
        return registration_table(
            changes, self.config["selection"], max_noise_fraction=max_noise_fraction
        )

    @cached_property
    def selected(self) -> pd.DataFrame:
        """Every patch with its pressure and whether it is in the study, from `select_patches`."""
        return select_patches(self.pressures, self.registration, self.config["selection"])

    @cached_property
    def worn_square(self) -> WornSquare | None:
        """The square as it wears, from `wear_stone`."""
        return wear_stone(
            self.contact,
            self.selected,
            self.registration,
            patch_mm=self.patch_mm,
            steps=self.config["wear_steps"],
            interlayer=self.config["interlayer"],
        )

    def contact_in(self, variant: str, patch: str) -> Contact:
        """Contact of a patch at its own pressure in a variant of the coupling."""
        stone: dict[str, Any] = {}
        if variant == PLACED:
            stone = {"composite": self.composite, "contact": self.contact}
        settings = self.config["microscale"] | {"contact_modulus_MPa": self.modulus}
        ((_, _, contact),) = solve_patches(
            {patch: self.prepared[patch, "T0"]},
            self.pressures,
            Microscale(**settings | {"steps": None}),
            variants=[variant],
            counterface=self.counterface,
            **stone,
        )
        assert isinstance(contact, Contact)  # without steps there is no path
        return contact

    def scored(self, *, seed: int | Sequence[int], resamples: int) -> dict[str, pd.DataFrame]:
        """The tables of `score_wear`."""
        contacts = {patch: self.contacts[patch] for patch in self.worn}
        changes = {patch: self.changes[patch] for patch in self.worn}
        worn, prediction = self.worn_square, Prediction({})
        if worn is not None:
            interlayer = fit_interlayer(worn, contacts, changes) if worn.interlayer else None
            cap = self.config["pressure_cap_MPa"]
            depths = {
                patch: wear_map(contact, worn, interlayer, patch, pressure_cap=cap)
                for patch, contact in contacts.items()
            }
            prediction = Prediction(depths, worn.fitted_to, interlayer)
        return score_wear(
            contacts,
            changes,
            prediction,
            self.selected,
            self.registration,
            expected_most_worn=self.config["validation"]["expected_most_worn"],
            seed=seed,
            resamples=resamples,
        )

    def _prepare(self, of: tuple[str, str]) -> xr.Dataset:
        """A clean scan, from `prepare_patch`."""
        patch, epoch = of
        row = self.patches.set_index("patch").loc[patch]
        crop = row[["crop_y_mm", "crop_x_mm"]]
        piece = None if crop.isna().any() else (float(crop.iloc[0]), float(crop.iloc[1]))
        return self._clean(self.read_scan(patch, epoch), piece, epoch, row.get("flip", ""))

    def _clean(
        self, raw: xr.DataArray, crop: Sequence[float] | None, epoch: str = "T0", flip: str = ""
    ) -> xr.Dataset:
        sections = {name: self.config[name] for name in ("scans", "preprocessing")}
        found = prepare_patch(raw, crop=crop, epoch=epoch, flip=flip, **sections)
        return found[["height", "filled", "outlier"]]

    def _register(self, patch: str) -> xr.Dataset:
        """Height change of a patch, from `register_patch`."""
        before, after = (self.prepared[patch, epoch] for epoch in ("T0", "T1"))
        settings = self._scanned_twice
        return register_patch(before, after, patch=patch, detection=self.detection, **settings)
