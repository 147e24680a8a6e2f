"""What comes out of a study when its config is changed in places.

Only what depends on the change is computed anew; the rest is read from the stored study. Contacts
are solved at their target pressure, without the states on the way.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.config import study_contact_modulus
from gstlib.contact import pressed_height
from gstlib.counterface import turned_over
from gstlib.coupling import patch_pressures, select_patches, shifted_places
from gstlib.io.store import read_attributes, read_dataset
from gstlib.io.tables import read_table
from gstlib.preprocess.patch import clean_scan
from gstlib.stages import grid_square, press_patch, press_square
from gstlib.validation.across import mean_gains, rank_correlations
from gstlib.validation.change import measured_change
from gstlib.validation.comparison import compare, score_patch, scores_of
from gstlib.validation.rivals import RIVALS
from gstlib.validation.scores import SCORES
from gstlib.validation.texture import texture_rows

__all__ = ["PRESSURE", "RELATIVE_CHANGE", "TEXTURE_CHANGE", "StoredStudy", "outcomes"]

PRESSURE = "pressure_MPa"
RELATIVE_CHANGE = "relative_change(pressure_MPa)"
TEXTURE_CHANGE = "mean_change(Sq_um)"
_RANKED = ("pressure_MPa", "loss_fraction")
_SURFACE = ["height", "filled", "outlier"]
_COLUMNS = ["output", "patch", "result", "low", "high"]


@dataclass(frozen=True)
class StoredStudy:
    """Files of a study, by patch where there are several.

    Attributes
    ----------
    mesh, surface, contact, pressures, texture : path
        The mesh; surface.h5 and contact.h5 of the macroscale; patch_pressures.csv; texture.csv.
    mesh_unit : str
    crops : dict
        Centre (x, y) of the piece to cut from each patch's scans, or None for a whole scan.
    t0_scans, t1_scans, t0, t1 : dict
        Scans, and clean surfaces. T1 for those patches that have it.
    registered, contacts : dict
        T1 laid over T0; contacts of the patches in the microscale study.
    counterface_scan, counterface : path or None
        Scan and clean surface of the active stone's face.
    """

    mesh: Path
    mesh_unit: str
    surface: Path
    contact: Path
    pressures: Path
    texture: Path
    crops: Mapping
    t0_scans: Mapping[str, Path]
    t1_scans: Mapping[str, Path]
    t0: Mapping[str, Path]
    t1: Mapping[str, Path]
    registered: Mapping[str, Path]
    contacts: Mapping[str, Path]
    counterface_scan: Path | None
    counterface: Path | None


def outcomes(study: StoredStudy, base: Mapping, config: Mapping) -> pd.DataFrame:
    """Patch pressures, scores and change of texture with a changed config.

    Parameters
    ----------
    study : StoredStudy
    base, config : mapping
        The config that the study was stored with, and the changed one: the sections of
        `gstlib.sweep.factors.SWEPT`, ``square`` and ``scans``.

    Returns
    -------
    pandas.DataFrame
        ``output, patch, result, low, high``: the pressure of every patch, ``studied`` (number of
        patches in the microscale study), the statistics of `gstlib.validation.across` and, over
        the patches, the mean change of Sq from T0 to T1 (µm). 95 % intervals where there are any.
    """
    return _Outcomes(study, base, config).table()


class _Outcomes:
    def __init__(self, study: StoredStudy, base: Mapping, config: Mapping):
        self.study, self.config = study, config

        def same(*names: str) -> bool:
            return all(_value(base, name) == _value(config, name) for name in names)

        # whether each stage gives what the study has stored
        self.grids = same("square", "macroscale.grid", "macroscale.margin_mm")
        self.presses = self.grids and same(
            "material", "macroscale.target_pressure_MPa", "macroscale.tolerance"
        )
        self.couples = self.presses and same("placement")
        self.cleans = same("scans", "preprocessing")
        self.lays_over = self.cleans and same("registration", "traces")
        self.presses_patches = self.couples and self.cleans and same("microscale")
        self.measures_texture = self.lays_over and same("texture")
        self.shift_um = [
            config["placement"][f"shift_{axis}_um"] - _value(base, f"placement.shift_{axis}_um", 0)
            for axis in "xy"
        ]
        self.contact_modulus_MPa = study_contact_modulus(config["material"])
        self.clean: dict[tuple[str, str], xr.Dataset] = {}

    def table(self) -> pd.DataFrame:
        selected = self.selected
        rows = [(PRESSURE, row.patch, row.pressure_MPa) for row in selected.itertuples()]
        rows.append(("studied", "", int(selected.in_study.sum())))
        scored = self.scored()
        if len(scored):
            chance = {
                "generator": np.random.default_rng(self.config["validation"]["seed"]),
                "resamples": self.config["validation"]["resamples"],
            }
            rows += [(f"mean({score})", "", scored[score].mean()) for score in SCORES]
            predictor, extent = _RANKED
            for part in (
                mean_gains(scored, RIVALS, **chance),
                rank_correlations(scored, predictors=[predictor], extents=[extent], **chance),
            ):
                values = part[["statistic", "value", "low", "high"]].itertuples(index=False)
                rows += [(name, "", *numbers) for name, *numbers in values]
        rows.append((TEXTURE_CHANGE, "", self.texture_change()))
        full = [(*row, math.nan, math.nan)[: len(_COLUMNS)] for row in rows]
        return pd.DataFrame(full, columns=_COLUMNS).dropna(subset="result", ignore_index=True)

    @cached_property
    def selected(self) -> pd.DataFrame:
        """Every patch with its pressure, and whether it is in the microscale study."""
        stored = read_table(self.study.pressures)
        if self.couples:
            pressures = stored.drop(columns=["in_study", "reason"])
        else:
            places = shifted_places(
                stored[["patch", "x_mm", "y_mm", "place", "rotation_deg"]],
                self.shift_um,
                size_mm=self.config["scans"]["size_mm"],
                square_mm=self.config["square"]["size_mm"],
            )
            pressures = patch_pressures(
                self.square_pressure(), places, size_mm=self.config["scans"]["size_mm"]
            )
        quality = pd.DataFrame(
            [{"patch": patch} | self.registered[patch][0] for patch in self.study.t1],
            columns=["patch", "overlap", "correlation"],
        )
        return select_patches(pressures, quality, **self.config["selection"])

    def square_pressure(self) -> xr.DataArray:
        if self.presses:
            return read_dataset(self.study.contact).pressure.isel(step=-1)
        macroscale = self.config["macroscale"]
        if self.grids:
            height = read_dataset(self.study.surface, only=["height"]).height
        else:
            height = grid_square(
                self.study.mesh,
                mesh_unit=self.study.mesh_unit,
                square=self.config["square"],
                grid=macroscale["grid"],
                margin_mm=macroscale["margin_mm"],
            )
        return press_square(
            height,
            source=self.study.mesh,
            macroscale=macroscale,
            contact_modulus_MPa=self.contact_modulus_MPa,
        )

    def surface(self, patch: str, epoch: str) -> xr.Dataset:
        """A patch's clean surface at "t0" or "t1"."""
        if self.cleans:
            return read_dataset(getattr(self.study, epoch)[patch], only=_SURFACE)
        if (patch, epoch) not in self.clean:
            scan = getattr(self.study, f"{epoch}_scans")[patch]
            self.clean[patch, epoch] = self.clean_anew(scan, self.study.crops[patch])
        return self.clean[patch, epoch]

    def clean_anew(self, scan: Path, crop: Sequence[float] | None) -> xr.Dataset:
        return clean_scan(
            scan,
            crop=crop,
            patch_mm=self.config["scans"]["size_mm"],
            scans=self.config["scans"],
            preprocessing=self.config["preprocessing"],
        )[_SURFACE]

    @cached_property
    def registered(self) -> dict[str, tuple[dict[str, float], xr.Dataset | None]]:
        """How well T1 lies over T0, and the height change where that is not as stored."""
        found = {}
        for patch in self.study.t1:
            if self.lays_over:
                attrs, change = read_attributes(self.study.registered[patch]), None
            else:
                registration, change = measured_change(
                    *(self.surface(patch, epoch) for epoch in ("t0", "t1")),
                    **self.config["registration"],
                    **self.config["traces"],
                )
                attrs = registration.as_attrs()
                change = change.assign_attrs(attrs)
            correlation = attrs["detail_correlation"] if attrs["registration_found"] else math.nan
            found[patch] = {"overlap": attrs["overlap"], "correlation": correlation}, change
        return found

    def change(self, patch: str) -> xr.Dataset:
        stored = self.registered[patch][1]
        return read_dataset(self.study.registered[patch]) if stored is None else stored

    def contact(self, patch: str, pressure_MPa: float) -> xr.Dataset:
        if self.presses_patches and patch in self.study.contacts:
            return read_dataset(self.study.contacts[patch])
        faces = self.surface(patch, "t0")[["height"]]
        if self.study.counterface_scan is not None:
            faces["counterface"] = turned_over(
                self.counterface.height,
                faces.height,
                source=self.study.counterface_scan,
                patch_source=patch,
            )
        return press_patch(
            faces,
            pressure_MPa=pressure_MPa,
            tolerance=self.config["microscale"]["tolerance"],
            contact_modulus_MPa=self.contact_modulus_MPa,
        )

    @cached_property
    def counterface(self) -> xr.Dataset:
        if self.cleans:
            return read_dataset(self.study.counterface, only=_SURFACE)
        return self.clean_anew(self.study.counterface_scan, None)

    def scored(self) -> pd.DataFrame:
        """Scores of every patch in the microscale study that has a T1."""
        lengths = {
            name: self.config["validation"][name]
            for name in ("neighbourhood_um", "curvature_length_um")
        }
        rows = []
        for row in self.selected[self.selected.in_study].itertuples():
            if row.patch not in self.study.t1:
                continue
            contact, change = self.contact(row.patch, row.pressure_MPa), self.change(row.patch)
            at = compare(pressed_height(contact), contact, change, **lengths)
            scores = score_patch(at, scores_of(at), change)
            rows.append({"patch": row.patch, "pressure_MPa": row.pressure_MPa} | scores)
        return pd.DataFrame(rows)

    def texture_change(self) -> float:
        """Mean over the patches of the change of Sq from T0 to T1, µm."""
        if self.measures_texture:
            table = read_table(self.study.texture)
        else:
            rows = [
                row
                for patch in self.study.t1
                for row in texture_rows(
                    self.surface(patch, "t0").height,
                    self.change(patch),
                    **self.config["texture"],
                )
            ]
            table = pd.DataFrame(rows, columns=["epoch", "Sq_um"])
        return float(table.Sq_um[table.epoch == "change"].mean())


def _value(config: Mapping, name: str, absent: object = None) -> object:
    """A value by its dotted name."""
    for key in name.split("."):
        if key not in config:
            return absent
        config = config[key]
    return config
