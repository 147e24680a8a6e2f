"""How much wears: Archard's law on the square and on its patches, with one coefficient for a stone.

What a patch loses in a step of sliding is κ p: wear coefficient × sliding, κ, times its pressure.
The square wears as a whole, so pressures move from patch to patch as the most heavily loaded sink
(`wear_square`); inside a patch, the summits wear first (`wear_patch`). The one unknown, κ, is
fitted to the measured loss. A prediction for a patch uses the κ of all the *other* patches.

Valleys wear too where something soft is between the stones: plants, hide, wood. An *interlayer*,
an elastic layer that takes turns with the bare stone, stands for it. How its coefficient compares
with that of the bare stone is fitted as κ is, to the maps of loss of the other patches
(`fit_interlayer`).

`gstlib.validation` says how good the predictions are.
"""

# ASSUME: κ is one number for the whole stone and all of its use; the active tool does not wear,
# and patches are pressed as before use by what surrounds them, at the pressure of each step.
# ASSUME: under another law, the loss of a patch follows its mean pressure. Its summits share the
# loss in proportion to their pressure, and pressures move between patches as under Archard's law.
# ASSUME: while it wears, the stone keeps the tilt that it rests with before use.
# ASSUME: κ makes the predicted and the measured loss of the patches equal in sum: a few deep
# traces count more than many shallow ones. The measured loss is that beyond its level of detection.
# ASSUME: an interlayer carries the same force over the square as the bare stone does, and is as
# thick everywhere; what is behind it is rigid for it, and elastic by itself as without it.
# ASSUME: where summits yield, a patch keeps the mean pressures of the elastic stone, but for what
# it cannot bear: at most nine tenths of the cap. What yields in one step is as high as before in
# the next, but for what wore off. ASSUME: T1 is laid on T0 where most points are. No scan sees
# what an interlayer takes off all points alike, so that a prediction, too, counts from the median
# of its depths.

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple, Self

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.bem.layer import Layer
from gstlib.bem.wear import ThirdBody, WearPath, wear_path
from gstlib.conditions import ARCHARD, Law
from gstlib.contact import Contact, solve_again
from gstlib.coupling.embedding import surroundings
from gstlib.coupling.pressures import covered, unseen
from gstlib.errors import InputError
from gstlib.macroscale.ensemble import patch_means
from gstlib.macroscale.gesture import Gesture, exposure, press_poses
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import described

__all__ = [
    "BARE",
    "CAPPED",
    "INTERLAYER",
    "Interlayer",
    "WornSquare",
    "driven",
    "layer_of",
    "seen_depth",
    "wear_contact",
    "wear_elastic_and_capped",
    "wear_patch",
    "wear_square",
]

# The square wears to the power of √2 (mm/MPa) next above so many times the κ that the losses of a
# patch's others and their first pressures give, or on to one of so many more where they are then
# short of their losses. So its own loss moves none of its steps, and most patches share a path.
_REACHES, _MORE = 1.25, 4
# Coefficients of the interlayer that are tried, over that of the bare stone.
_RATIOS = 0.0, 0.1, 0.3, 1.0, 3.0
_BODIES = "stone", "interlayer"
# Largest mean pressure of a patch over the cap on the pressure of its elements.
_BORNE = 0.9

_OF_PATCHES = "pressure_MPa", "x_mm", "y_mm", "rotation_deg"
_DESCRIBED = {
    "reach": ("mm/MPa", "κ of the bare stone at the end of a path"),
    "kappa": ("mm/MPa", "wear coefficient × sliding"),
    "pressed": ("mm", "mean depth that one body alone would remove"),
    "pressed_covered": (
        "mm",
        "mean depth that the stone would remove where both scans are",
    ),
    "fitted": ("mm/MPa", "κ of other patches"),
    "kappa_of_all": ("mm/MPa", "κ of all patches"),
    "reach_of": ("mm/MPa", "end of the path of a patch, from the others' losses"),
    "reach_of_all": ("mm/MPa", "the same of all patches"),
    "measured": ("mm", "measured mean depth lost"),
    "pressure_MPa": ("MPa", "pressure before use"),
    "patch_mm": ("mm", "side of a patch"),
    "x_mm": ("mm", "centre of the patch along x"),
    "y_mm": ("mm", "centre of the patch along y"),
    "rotation_deg": ("degree", "turn of the patch, x towards y"),
}
_OF_LAYER = {
    "young": ("MPa", "Young's modulus of the interlayer"),
    "poisson": ("1", "Poisson's ratio of the interlayer"),
    "thickness": ("mm", "thickness of the interlayer"),
}

# The predictions: Archard's law, and what is changed in it.
BARE, INTERLAYER, CAPPED = "archard", "interlayer", "archard_capped"


class Interlayer(NamedTuple):
    """What takes turns with the bare stone.

    Attributes
    ----------
    layer : gstlib.bem.Layer
    pressure : (y, x) xarray.DataArray
        Under it on the square before use, MPa.
    fitted : xarray.Dataset or None
        Its coefficient, from `gstlib.wear.interlayer.fit_interlayer`.
    """

    layer: Layer
    pressure: xr.DataArray
    fitted: xr.Dataset | None = None


class WornSquare(NamedTuple):
    """How the square wears.

    Attributes
    ----------
    path : xarray.Dataset
        By ``reach``, κ of the bare stone up to which it wears, and ``ratio`` of the interlayer's
        coefficient to the bare stone's, 0 alone without an interlayer: ``kappa`` (reach, ratio,
        step), both bodies' together, mm/MPa, from 0 on; ``pressed`` (reach, ratio, body, step,
        patch): mean depth that one body alone would remove, mm. ``pressed_covered`` (reach, ratio,
        step, patch): that of the stone over the area that both scans of a patch cover, which is
        the area of its measured loss. ``fitted`` (patch): κ of the bare stone from the measured
        losses of all other patches, and ``reach_of`` (patch) the path that they lead to;
        ``kappa_of_all``, ``reach_of_all``: from all. ``measured`` (patch), mm, NaN where κ is not
        fitted to a patch; ``pressure_MPa`` before use and ``x_mm, y_mm, rotation_deg`` (patch);
        ``patch_mm``. The attribute ``wear_law`` has the fields of `law`, unless it is Archard's.
    interlayer : Interlayer or None
    """

    path: xr.Dataset
    interlayer: Interlayer | None

    @classmethod
    def from_datasets(cls, path: xr.Dataset, fitted: xr.Dataset | None) -> Self | None:
        """From its `path` and `fitted_interlayer` as stored; None where wear is not predicted."""
        if not path.sizes:
            return None
        if fitted is None:
            return cls(path, None)
        layer = Layer(*(float(fitted[name]) for name in _OF_LAYER))
        return cls(path, Interlayer(layer, fitted.pressure, fitted))

    @property
    def law(self) -> Law:
        """How the loss of a patch grows with its pressure."""
        return Law(*self.path.attrs.get("wear_law", ARCHARD))

    @property
    def fitted_interlayer(self) -> xr.Dataset | None:
        """The fitted coefficient of the interlayer, and the interlayer itself.

        Its ``young`` (MPa), ``poisson`` and ``thickness`` (mm), and the ``pressure`` (y, x), MPa,
        under it on the square before use.
        """
        if self.interlayer is None:
            return None
        layer, pressure, fitted = self.interlayer
        if fitted is None:
            return None
        constants = described(
            xr.Dataset({name: getattr(layer, name) for name in _OF_LAYER}), _OF_LAYER
        )
        return fitted.assign(constants.data_vars).assign(pressure=pressure)

    def along(self, patch: str, ratio: float) -> xr.Dataset:
        """The path that a patch wears along, of whose steps its own loss knows nothing."""
        at = self.path.sel(patch=patch, ratio=ratio)
        return at.sel(reach=float(at.reach_of))

    @property
    def fitted_to(self) -> list[str]:
        """The patches that κ is fitted to."""
        return self.path.patch.values[np.isfinite(self.path.measured.values)].tolist()


def layer_of(interlayer: Mapping[str, float]) -> Layer:
    """The layer of the section ``interlayer`` of the config."""
    thickness_mm = interlayer["thickness_um"] * 1e-3
    return Layer(interlayer["young_MPa"], interlayer["poisson"], thickness_mm)


def wear_square(
    contact: Contact,
    pressures: pd.DataFrame,
    losses_um: Mapping[str, float],
    *,
    patch_mm: float,
    steps: int,
    interlayer: Layer | None = None,
    gesture: Gesture | None = None,
    law: Law = ARCHARD,
) -> WornSquare:
    """Wear the square, follow the patches' pressures, and fit κ.

    Parameters
    ----------
    contact : Contact
        The face's at the target load.
    pressures : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg`` of every patch, and ``pressure_MPa`` before use, and
        ``covered_MPa`` with the place of T1 from `gstlib.surfaces.footprints.with_t1` where T1
        does not cover all of T0. With ``leave_one_out_MPa``, from
        `gstlib.use.outcome.pressures_of_use`, a patch wears at that pressure where it is known, and
        not at one that its own loss has a part in.
    losses_um : mapping
        Measured mean loss over each patch that κ is fitted to, µm, finite; of two at least.
    patch_mm : float
        Side of a patch.
    steps : int
        Implicit steps of the path.
    interlayer : gstlib.bem.Layer, optional
        What takes turns with the bare stone.
    gesture : Gesture, optional
        In each step all its poses take off what their pressure and sliding say, in place of the
        single pose. Not with an interlayer.
    law : Law
        How the loss of a patch grows with its pressure. Other laws than Archard's have neither
        interlayer nor gesture.

    Raises
    ------
    InputError
        The square cannot lose so much under these patches.
    """
    measured = pd.Series(losses_um, dtype=float) * 1e-3
    table = pressures.set_index("patch", drop=False)
    # an interlayer adds to what the bare stone does
    ratios = _RATIOS if interlayer else _RATIOS[:1]
    outlines = table[["patch", *_OF_PATCHES]]
    # over the outlines, then over the areas that both scans cover
    means = scipy.sparse.vstack(
        [
            patch_means(contact.pressure, areas, size_mm=patch_mm)
            for areas in (outlines, table)
        ]
    )

    @cache
    def path_to(reach: float) -> xr.Dataset:
        if gesture is None:
            depths = [
                _pressed(contact, means, (1 + ratio) * reach, ratio, interlayer, steps)
                for ratio in ratios
            ]
        else:
            depths = [
                _pressed_in_poses(
                    contact, gesture, table, means, reach, patch_mm, steps
                )
            ]
        paths = [
            _without_own_loss(_path(kappa, pressed, table), table)
            for kappa, pressed in depths
        ]
        return xr.concat(paths, pd.Index(ratios, name="ratio"))

    others = [measured.drop(patch, errors="ignore") for patch in table.patch]
    fitted = [
        _fit(path_to, unseen(table), losses, law) for losses in (measured, *others)
    ]
    fits, reaches = zip(*fitted, strict=True)
    ends = sorted({*reaches})
    path = xr.concat([path_to(end) for end in ends], pd.Index(ends, name="reach"))
    path = path.assign(
        fitted=("patch", list(fits[1:])),
        reach_of=("patch", list(reaches[1:])),
        kappa_of_all=fits[0],
        reach_of_all=reaches[0],
        measured=("patch", measured.reindex(table.index)),
        patch_mm=patch_mm,
    )
    path = path.assign({name: ("patch", table[name]) for name in _OF_PATCHES})
    path = described(path, _DESCRIBED)
    if law != ARCHARD:
        path.attrs["wear_law"] = [*law]
    if interlayer is None:
        return WornSquare(path, None)
    return WornSquare(
        path, Interlayer(interlayer, _under_interlayer(contact, interlayer))
    )


def wear_contact(contact: Contact, source: str, **options: Any) -> WearPath:
    """Wear the interface of a contact, with the `options` of `gstlib.bem.wear_path`."""
    path: WearPath = solve_again(contact, source, wear_path, **options)
    return path


def _under_interlayer(contact: Contact, interlayer: Layer) -> xr.DataArray:
    """Pressure (y, x) on the square under an interlayer before use, MPa."""
    mean_pressure = float(contact.pressure.mean())
    state = solve_again(
        contact, "macroscale", mean_pressure=mean_pressure, layer=interlayer
    )
    return contact.pressure.copy(data=state.pressure)


def _pressed(
    contact: Contact,
    means: "scipy.sparse.csr_array",
    kappa: float,
    ratio: float,
    interlayer: Layer | None,
    steps: int,
) -> tuple[np.ndarray, np.ndarray]:
    """κ in each step, and the mean depths (body, step, area) over the areas of `means`."""
    target = float(contact.pressure.mean())
    share = ratio / (1 + ratio)
    path = wear_contact(
        contact,
        "macroscale",
        mean_pressure=target,
        mean_loss=kappa * target,
        steps=steps,
        third_body=ThirdBody(interlayer, share, target) if interlayer else None,
        keep_states=True,
    )
    pressed = np.zeros((len(_BODIES), steps + 1, means.shape[0]))
    for body, states in enumerate(zip(*path.states, strict=True)):
        in_steps = [means @ state.pressure.ravel() for state in states]
        pressed[body, 1:] = kappa / steps * np.cumsum(in_steps, axis=0)
    return np.linspace(0, kappa, steps + 1), pressed


def _pressed_in_poses(
    contact: Contact,
    gesture: Gesture,
    table: pd.DataFrame,
    means: "scipy.sparse.csr_array",
    kappa: float,
    patch_mm: float,
    steps: int,
) -> tuple[np.ndarray, np.ndarray]:
    """As `_pressed`, by all poses of a gesture in each of as many explicit steps.

    The exposure takes the place of the pressure, in units in which its mean is the mean pressure.
    """
    target = float(contact.pressure.mean())
    height = contact.interface.height
    pressed = np.zeros((len(_BODIES), steps + 1, means.shape[0]))
    for step in range(steps):
        batch = press_poses(
            height,
            gesture,
            table,
            contact_modulus_MPa=contact.modulus,
            tolerance=contact.tolerance,
            patch_mm=patch_mm,
        )
        exposed = exposure([batch]).exposure
        mean = float(exposed.mean())
        if not mean > 0:
            raise InputError(
                "gesture", "no pose presses the stone", "Correct its poses."
            )
        depth = kappa / steps * target / mean * exposed.values
        pressed[0, step + 1] = pressed[0, step] + means @ depth.ravel()
        height = height.copy(data=height.values - depth)
    return np.linspace(0, kappa, steps + 1), pressed


def _without_own_loss(path: xr.Dataset, table: pd.DataFrame) -> xr.Dataset:
    """The path at pressures under the use that the wear of the other patches says."""
    other = (unseen(table) - covered(table)).to_numpy()
    if not other.any():
        return path
    # ASSUME: the use that the other patches say changes a patch's pressure by as much over its
    # outline as over the area that both scans cover.
    # ASSUME: what the wear of the square changes in a patch's pressure is as under the whole use;
    # where that would leave less than none, the patch bears none in this step.
    # ASSUME: the tilt of a patch, its surroundings, and the pressures of the patches that κ comes
    # from may be those of a use that its own loss has a part in: each patch would take a path of
    # its own otherwise.
    changed = {}
    for name in ("pressed", "pressed_covered"):
        changed[name] = path[name].copy()
        steps = np.diff(path[name].values, axis=-2)
        added = np.diff(path.kappa)[:, np.newaxis] * other
        steps = np.maximum(steps + added, 0)
        changed[name][..., 1:, :] = np.cumsum(steps, axis=-2)
    return path.assign(changed)


def _path(kappa: np.ndarray, pressed: np.ndarray, table: pd.DataFrame) -> xr.Dataset:
    """The path from mean depths (body, step, area), over outlines and then over covered areas."""
    outlines, areas = np.split(pressed, 2, axis=-1)
    return xr.Dataset(
        {
            "kappa": ("step", kappa),
            "pressed": (("body", "step", "patch"), outlines),
            "pressed_covered": (("step", "patch"), areas[0]),
        },
        coords={"body": list(_BODIES), "patch": list(table.patch)},
    )


def _fit(
    path_to: Callable[[float], xr.Dataset],
    pressures: pd.Series,
    measured: pd.Series,
    law: Law,
) -> tuple[float, float]:
    """The κ at which the patches of `measured` have lost as much in sum, and its path's end."""
    patches, total = list(measured.index), measured.sum()
    equivalent = pd.Series(law.equivalent(pressures.to_numpy()), pressures.index)
    start = _REACHES * total / equivalent[patches].sum()
    first = math.ceil(2 * math.log2(start))
    for power in range(first, first + _MORE + 1):
        reach = 2.0 ** (power / 2)
        path = path_to(reach).sel(ratio=0)
        pressed = path.pressed_covered.transpose("step", "patch")
        removed = _removed(pressed.values, path.kappa.values, law, pressures.to_numpy())
        lost = pressed.copy(data=removed).sel(patch=patches).sum("patch").values
        if total <= lost[-1]:
            return float(np.interp(total, lost, path.kappa)), reach
    raise InputError(
        "macroscale",
        "the measured losses are more than this square can lose under its patches",
        "Look for a patch whose T1 is wrong.",
    )


def _removed(
    pressed: np.ndarray, kappa: np.ndarray, law: Law, before: np.ndarray
) -> np.ndarray:
    """Depth (steps, …) that a law removes at the pressures at which Archard's removes `pressed`.

    `before` are the pressures of all patches before use, MPa.
    """
    if law == ARCHARD:
        return pressed
    sliding = np.diff(kappa).reshape(-1, *[1] * (pressed.ndim - 1))
    pressures = np.diff(pressed, axis=0) / sliding
    removed = np.zeros_like(pressed)
    removed[1:] = np.cumsum(sliding * law.equivalent(pressures, before), axis=0)
    return removed


def seen_depth(depth: np.ndarray) -> np.ndarray:
    """The part of a lost depth that two scans can show: T1 is laid on T0 where most points are."""
    return depth - np.median(depth)


def wear_patch(
    contact: Contact,
    worn: WornSquare,
    patch: str,
    *,
    ratio: float = 0.0,
    kappa: float | None = None,
    pressure_cap: float | None = None,
) -> np.ndarray:
    """Wear a patch at the pressures that the wearing square gives it.

    Parameters
    ----------
    contact : Contact
        The patch's, before use.
    worn : WornSquare
    patch : str
    ratio : float
        One of those of `worn`.
    kappa : float, optional
        mm/MPa; by default that of the bare stone from the other patches.
    pressure_cap : float, optional
        Cap on the pressure of an element. It moves wear within the patch; how much the patch
        loses depends on its mean pressure alone, of which it bears at most nine tenths of the
        cap.

    Returns
    -------
    ndarray, shape (ny, nx)
        The depth lost, mm.
    """
    return wear_elastic_and_capped(
        contact, worn, patch, ratio=ratio, kappa=kappa, pressure_cap=pressure_cap
    )[-1]


def wear_elastic_and_capped(
    contact: Contact,
    worn: WornSquare,
    patch: str,
    *,
    ratio: float = 0.0,
    kappa: float | None = None,
    pressure_cap: float | None = None,
) -> list[np.ndarray]:
    """The depth of `wear_patch` without a cap and, if there is one, that with it."""
    kappa = float(worn.path.fitted.sel(patch=patch)) if kappa is None else kappa
    lost, options = driven(contact, worn, worn.along(patch, ratio), kappa)
    count = 1 if pressure_cap is None else 2
    if not lost > 0:
        return count * [np.zeros(contact.pressure.shape)]
    elastic = wear_contact(contact, f"patch {patch}", **options)
    if pressure_cap is None:
        return [elastic.depth]
    bounded = _bounded(options, ratio, pressure_cap, worn.law)
    # Where no pressure reaches the cap, each of its contacts is that without it.
    is_borne = math.isclose(bounded["mean_loss"], lost, rel_tol=1e-12)
    if is_borne and elastic.highest_pressure < pressure_cap:
        return [elastic.depth, elastic.depth]
    return [elastic.depth, wear_contact(contact, f"patch {patch}", **bounded).depth]


def driven(
    contact: Contact, worn: WornSquare, at: xr.Dataset, kappa: float
) -> tuple[float, dict]:
    """Mean loss (mm) of a patch at a κ, and the settings of `wear_path` that lead to it.

    `at` is the path of the square there, at one reach and one ratio.
    """
    ratio, steps = float(at.ratio), at.sizes["step"] - 1
    share = ratio / (1 + ratio)
    fine = kappa * np.arange(steps + 1) / steps
    pressed = [np.interp(fine, at.kappa, at.pressed.sel(body=body)) for body in _BODIES]
    stone, soft = (np.diff(depth) / fine[1] for depth in pressed)
    before = worn.path.pressure_MPa.values
    removed = [_removed(depth, fine, worn.law, before)[-1] for depth in pressed]
    lost = (1 - share) * removed[0] + share * removed[1]
    options: dict[str, Any] = {
        "mean_pressure": stone,
        "mean_loss": lost,
        "steps": steps,
    }
    if ratio and worn.interlayer:
        lowered = _lowered(contact, at, worn.interlayer)
        options["third_body"] = ThirdBody(worn.interlayer.layer, share, soft, lowered)
    return lost, options


def _bounded(options: dict, ratio: float, pressure_cap: float, law: Law) -> dict:
    """The settings of `driven` with a cap on the pressure, and no more than it lets pass."""
    most = _BORNE * pressure_cap
    share = ratio / (1 + ratio)
    body = options.get("third_body")
    stone = np.minimum(options["mean_pressure"], most)
    asked = (1 - share) * law.rate(options["mean_pressure"]).sum()
    borne = (1 - share) * law.rate(stone).sum()
    bounded: dict[str, Any] = {"mean_pressure": stone, "pressure_cap": pressure_cap}
    if body is not None:
        soft = np.minimum(body.mean_pressure, most)
        bounded["third_body"] = replace(body, mean_pressure=soft)
        asked += share * body.mean_pressure.sum()
        borne += share * soft.sum()
    return options | bounded | {"mean_loss": options["mean_loss"] * borne / asked}


def _lowered(
    contact: Contact, at: xr.Dataset, interlayer: Interlayer
) -> np.ndarray | float:
    """How much lower (mm) its surroundings put a patch under an interlayer than without one."""
    around = contact.interface.surroundings
    if around is None:
        return 0.0
    under_interlayer = surroundings(
        interlayer.pressure,
        PatchPosition.from_dataset(at),
        around.shape,
        size_mm=float(at.patch_mm),
        contact_modulus_MPa=contact.modulus,
        layer=interlayer.layer,
    )
    return under_interlayer - around
