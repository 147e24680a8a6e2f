"""The method: all stages of the study, in the order of the paper, each in the room of its name.

It follows section 2 of Marulli, Sorrentino & Paggi (2024, J. Archaeol. Sci. Rep. 104939) and goes
on where the paper stops. A room is a folder beside this file; it imports only from rooms that come
before it.

1. `preprocess`: the use-face of the tool's mesh becomes heights on a grid (`mesh.grid_mesh`); scans
   are cleaned, filled and levelled (`scans.prepare_patch`).
2. `macroscale`: the face is the square and what is around it (`face.grid_macroscale`). The scans
   are laid on it where they were taken (`composite.compose_surface`). A rounded active stone, or a
   second mesh that was posed on it (`active_tool`), is pressed on the whole by the force of use,
   and both come to rest (`gstlib.contact.contact_path`); the hand wanders, and the stone moves
   (`gesture.press_poses`).
3. `coupling`: each scanned patch carries the macroscale forces in its outline
   (`pressures.couple_scales`): a pressure with an interval (`intervals.pressure_intervals`).
   `placement.place_patches` checks where the patches lie.
4. `microscale`: each patch, as it lies on the stone, is pressed at the scan's resolution up to its
   own pressure (`patches.solve_patches`). Stick and slip and a ceiling on the pressure are further
   cases (`slip_and_cap`).
5. `change`: T1 is registered to T0, which gives the height that use took away
   (`change.register_patch`), and the texture is measured before and after use
   (`texture.measure_texture`). `selection.select_patches` says which patches enter the study.
6. `wear`: the square and its patches wear by Archard's law (`fit.wear_stone`), which predicts the
   loss of a patch from those of the others (`fit.wear_map`).
7. `validation`: the predicted loss is judged by the measured one, beside rivals that know as much
   (`summary.judge_wear`).

Two variants of the coupling exist. In the paper's, `LEVELLED`, the square is cut out of the mesh,
pressed flat on its mean plane up to a mean pressure, and a patch is pressed as its scan was
levelled. In `PLACED`, the stone lies where its forces balance, the scans enter its face, and a
patch keeps its plane in it and yields to the pressures around it. Both are held against one contact
of the whole square at the scans' resolution, which is placed in the face likewise
(`validation.single_scale.press_whole`).

The functions take and return datasets and tables, and read and write no file of results: the
workflow's scripts do, one stage each. `Study` runs the same stages in memory, for sweeps over
settings and for many generated specimens.

Lengths are in mm and pressures in MPa unless a name says otherwise. Words mean the same everywhere:

- a *surface* is heights on a grid, an array (y, x) in mm (`gstlib.surfaces.grid`);
- the *face* is the dataset of `gstlib.macroscale.face.grid_macroscale`, the square and what is
  around it; the *counterface* is what is pressed on it;
- *patches* is the patch table, *pressures* that table with the pressure of each patch;
- *scans*, *contacts* and *changes* are prepared scans, contacts and height changes, each a dataset,
  by patch; such a mapping may read them when they are looked up (`gstlib.io.store.Stored`);
- a *contact* is the state of two faces at one load (`gstlib.contact`).
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar, cast

import pandas as pd
import xarray as xr

from gstlib.change.change import Detection, measure_detection, register_patch
from gstlib.change.selection import registration_table, select_patches
from gstlib.conditions import load_force, load_point, study_modulus
from gstlib.contact import Loading, contact_at_pressure, faces_of
from gstlib.coupling.pressures import couple_scales
from gstlib.macroscale.active_tool import SecondStone
from gstlib.macroscale.composite import compose_surface
from gstlib.macroscale.face import grid_macroscale, square_alone
from gstlib.microscale.patches import PLACED, Microscale, solve_patches
from gstlib.preprocess.scans import prepare_patch
from gstlib.validation.summary import judge_wear
from gstlib.wear.archard import WornSquare
from gstlib.wear.fit import wear_map, wear_stone
from gstlib.wear.interlayer import fit_mat

if TYPE_CHECKING:
    import trimesh

__all__ = [
    "PLACED",
    "STUDY_SECTIONS",
    "Microscale",
    "Study",
    "judge_wear",
    "prepare_patch",
    "solve_patches",
    "wear_stone",
]

_log = logging.getLogger(__name__)

# The sections of the config that the stages of `Study` depend on, besides `seed`.
STUDY_SECTIONS = (
    "coupling",
    "square",
    "material",
    "counterface",
    "load",
    "macroscale",
    "scans",
    "preprocessing",
    "registration",
    "traces",
    "texture",
    "uncertainty",
    "selection",
    "microscale",
    "validation",
    "hardness",
    "wear_steps",
    "mat",
)

# --- The scans --------------------------------------------------------------------------------


# --- The patches ------------------------------------------------------------------------------


# --- Wear ------------------------------------------------------------------------------------


# --- Was the prediction right? ----------------------------------------------------------------


# --- The whole in memory ----------------------------------------------------------------------

Stage = TypeVar("Stage", bound=Callable[..., Any])


def _stage(compute: Stage) -> Stage:
    """A method of `Study` whose result is kept."""

    @wraps(compute)
    def kept(self: "Study", *of: str) -> Any:
        key = (compute.__name__, *of)
        if key not in self.kept:
            self.kept[key] = compute(self, *of)
        return self.kept[key]

    return cast(Stage, kept)


class Study:
    """A study in memory: each stage is computed when it is first asked for, and kept.

    Contacts are solved at the target pressure alone, without the steps on the way to it.

    Parameters
    ----------
    config : mapping
        ``seed`` and the sections `STUDY_SECTIONS`.
    patches : pandas.DataFrame
        The patch table, with ``t1``, empty where there is none; ``repeat``, likewise, and
        ``flip`` may be missing.
    read_mesh : callable
        Gives the stone's mesh, mm.
    read_scan : callable
        Gives the raw scan (y, x) of a patch at an epoch, ``("5", "T0")``; a repeat is an epoch.
    read_face : callable, optional
        Gives the raw scan of the active stone's own face.
    second_stone : SecondStone, optional
        By default the active stone is a flat.
    kept : mapping, optional
        Results of stages that are known already, by the stage's name and what it is of (a patch,
        an epoch).
    """

    def __init__(
        self,
        config: Mapping[str, Any],
        patches: pd.DataFrame,
        *,
        read_mesh: Callable[[], "trimesh.Trimesh"],
        read_scan: Callable[[str, str], xr.DataArray],
        read_face: Callable[[], xr.DataArray] | None = None,
        second_stone: SecondStone | None = None,
        kept: Mapping[tuple[str, ...], Any] | None = None,
    ):
        self.config, self.patches = config, patches
        self.worn = patches.patch[patches.t1 != ""].tolist()
        twice = patches[patches["repeat"] != ""] if "repeat" in patches else patches[:0]
        self.repeated = twice.patch.tolist()
        self.read_mesh, self.read_scan, self.read_face = read_mesh, read_scan, read_face
        self.second_stone = second_stone
        self.kept = dict(kept or {})
        self._modulus = study_modulus(config["material"])

    @_stage
    def face(self) -> xr.Dataset:
        """The face, from `grid_macroscale`; the paper's is the square, under a flat."""
        macroscale, form = self.config["macroscale"], self.config["counterface"] or {}
        around: dict[str, Any] = {}
        if self._is_placed:
            around = {"face_mm": macroscale["face_mm"], "radius_mm": form.get("radius_mm")}
            around["second_stone"] = self.second_stone
        face, _ = grid_macroscale(
            self.read_mesh(),
            **self.config["square"],
            **{name: macroscale[name] for name in ("grid", "interpolation")},
            **around,
        )
        return face

    @property
    def _patch_mm(self) -> float:
        return self.config["scans"]["size_mm"]

    @property
    def _is_placed(self) -> bool:
        return self.config["coupling"] == PLACED

    @_stage
    def composite(self) -> xr.Dataset:
        """The scans laid on the mesh's surface, from `compose_surface`."""
        return compose_surface(
            self.face(),
            self.patches,
            {patch: self.prepared(patch, "T0") for patch in self.patches.patch},
            patch_mm=self._patch_mm,
            s_filter_um=self.config["microscale"]["s_filter_um"],
            placement_um=self.config["uncertainty"]["placement_um"],
            seed=self.config["seed"],
        )

    @_stage
    def contact(self) -> xr.Dataset:
        """Contact of the stone at rest under its load; the paper's of the square alone."""
        if not self._is_placed:
            return self.square_contact()
        whole, load = self.composite(), self.config["load"]
        loading = Loading.by_force(
            load_force(load, self.config["square"]["size_mm"]),
            load_point(load, self.config["square"]["size_mm"]),
            whole.height,
            contact_modulus_MPa=self._modulus,
            tolerance=self.config["macroscale"]["tolerance"],
        )
        faces = faces_of(whole.height, whole.counterface)
        return contact_at_pressure(faces, loading, source="macroscale")

    @_stage
    def square_contact(self) -> xr.Dataset:
        """Contact of the square alone at the mean pressure."""
        size_mm = self.config["square"]["size_mm"]
        pressure = load_force(self.config["load"], size_mm) / size_mm**2
        loading = Loading(self._modulus, pressure, self.config["macroscale"]["tolerance"])
        return contact_at_pressure(square_alone(self.face()), loading, source="macroscale")

    @_stage
    def pressures(self) -> pd.DataFrame:
        """Pressure of every patch, from `gstlib.coupling.pressures.couple_scales`."""
        contacts = self.contact(), self.square_contact()
        return couple_scales(*contacts, self.patches, patch_mm=self._patch_mm)

    @_stage
    def prepared(self, patch: str, epoch: str) -> xr.Dataset:
        """A clean scan, from `prepare_patch`."""
        table = self.patches.set_index("patch")
        crops = table[["crop_y_mm", "crop_x_mm"]].dropna()
        crop = tuple(crops.loc[patch]) if patch in crops.index else None
        flip = table.flip[patch] if "flip" in table else ""
        return self._clean(self.read_scan(patch, epoch), crop, epoch, flip)

    def _clean(
        self, raw: xr.DataArray, crop: Sequence[float] | None, epoch: str = "T0", flip: str = ""
    ) -> xr.Dataset:
        sections = {name: self.config[name] for name in ("scans", "preprocessing")}
        found = prepare_patch(raw, crop=crop, epoch=epoch, flip=flip, **sections)
        return found[["height", "filled", "outlier"]]

    @_stage
    def counterface(self) -> xr.DataArray | None:
        """The clean scan of the active stone's own face."""
        return self._clean(self.read_face(), None).height if self.read_face else None

    @_stage
    def change(self, patch: str) -> xr.Dataset:
        """Height change of a patch, from `register_patch`."""
        epochs = (self.prepared(patch, epoch) for epoch in ("T0", "T1"))
        settings = self.config["registration"] | self.config["traces"]
        return register_patch(*epochs, patch=patch, detection=self.detection(), **settings)

    @_stage
    def detection(self) -> Detection | None:
        """The error of a height change, from `measure_detection`; None without repeats."""
        epochs = (
            {patch: self.prepared(patch, epoch) for patch in self.repeated}
            for epoch in ("T0", "repeat")
        )
        settings = self.config["registration"] | self.config["traces"]
        return measure_detection(*epochs, **settings)

    @_stage
    def registration(self) -> pd.DataFrame:
        """How well T1 matches T0, and what was lost, from `registration_table`."""
        changes = {patch: self.change(patch) for patch in self.worn}
        most_noise = self.config["validation"]["most_noise"]
        return registration_table(changes, self.config["selection"], most_noise=most_noise)

    @_stage
    def selected(self) -> pd.DataFrame:
        """Every patch with its pressure and whether it is in the study, from `select_patches`."""
        return select_patches(self.pressures(), self.registration(), self.config["selection"])

    @_stage
    def patch_contact(self, patch: str) -> xr.Dataset:
        """Contact of a patch at its own pressure, in the study's own variant."""
        return self.contact_in(self.config["coupling"], patch)

    def contact_in(self, variant: str, patch: str) -> xr.Dataset:
        """Contact of a patch at its own pressure in a variant of the coupling."""
        stone = {}
        if variant == PLACED:
            stone = {"composite": self.composite(), "contact": self.contact()}
        settings = self.config["microscale"] | {
            "contact_modulus_MPa": self._modulus,
            "steps": None,
        }
        ((_, _, contact),) = solve_patches(
            {patch: self.prepared(patch, "T0")},
            self.pressures(),
            Microscale(**settings),
            variants=[variant],
            counterface=self.counterface(),
            **stone,
        )
        return contact

    @_stage
    def worn_square(self) -> WornSquare | None:
        """The square as it wears, from `wear_stone`."""
        return wear_stone(
            self.contact(),
            self.selected(),
            self.registration(),
            patch_mm=self._patch_mm,
            steps=self.config["wear_steps"],
            mat=self.config["mat"],
        )

    def judged(self, *, seed: int | Sequence[int], resamples: int) -> dict[str, pd.DataFrame]:
        """The tables of `judge_wear`."""
        contacts, changes = (
            {patch: of(patch) for patch in self.worn}
            for of in (self.patch_contact, self.change)
        )
        worn, mat, predicted = self.worn_square(), None, {}
        if worn is not None:
            mat = fit_mat(worn, contacts, changes) if worn.mat else None
            hardness = self.config["hardness"]
            predicted = {
                patch: wear_map(contact, worn, mat, patch, hardness_MPa=hardness)
                for patch, contact in contacts.items()
            }
        return judge_wear(
            contacts,
            changes,
            predicted,
            self.selected(),
            self.registration(),
            fitted_to=worn.fitted_to if worn else (),
            mat=mat,
            expected_worst=self.config["validation"]["expected_worst"],
            seed=seed,
            resamples=resamples,
        )
