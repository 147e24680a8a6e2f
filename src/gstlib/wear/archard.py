"""Archard's law on the square and on its patches, with one wear coefficient for a stone.

In a step of sliding, a patch loses κ p: κ, the wear coefficient times the sliding, times its
pressure. The square wears as a whole, so pressures move between patches as the most heavily loaded
ones sink (`wear_square`). Within a patch, the summits wear first (`wear_patch`). The only unknown,
κ, is fitted to the measured losses. A prediction for a patch uses the κ of all the *other* patches.

Valleys wear too if something soft is between the stones, such as plants, hide or wood. An
*interlayer* represents it, an elastic layer that alternates with the bare stone. The ratio of its
coefficient to the coefficient of the bare stone is fitted to the maps of loss of the other patches,
like κ (`fit_interlayer`).

`gstlib.validation` tests the predictions.
"""

# ASSUME: One wear coefficient. κ is one number for the whole stone and all of its use. Reason: Each
# further coefficient would have to be fitted to losses of its own.
# ASSUME: Active tool and surroundings during wear. The active tool does not wear. The surroundings
# press a patch as before use, at the pressure of each step. Reason: The wear of the active tool is
# not measured, and each patch can then wear by itself.
# ASSUME: Other laws within a patch. Under another law, the loss of a patch follows from its mean
# pressure, and its summits share this loss in proportion to their pressure. Pressures move between
# patches as under Archard's law. Reason: One path of wear then serves all laws.
# ASSUME: Tilt during wear. The stone keeps its tilt before use while it wears. Reason: A new
# equilibrium in each step would need many more contacts.
# ASSUME: Fit of κ. The predicted and the measured losses of the patches have the same sum. A
# measured loss is the loss beyond its level of detection. Reason: A few deep traces then count more
# than many shallow ones.
# ASSUME: Mechanics of the interlayer. The interlayer has a uniform thickness, and the square
# carries the same force as with the bare stone. The stone is rigid for the layer, and deforms as
# without it. Reason: The compliances of layer and stone then add.
# ASSUME: Wear under a pressure cap. A patch keeps its mean pressure on the elastic stone, but at
# most nine tenths of the cap. Points at the cap in one step have their height in the next step,
# except for wear. Reason: A patch cannot carry more than its elements.
# ASSUME: Datum of a predicted loss. A predicted loss is measured from the median of its depths.
# Reason: T1 is registered to T0 at the level of most points. So two scans do not show a loss that
# all points share.

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
    "WornSquare",
    "driven",
    "seen_depth",
    "wear_contact",
    "wear_patch",
    "wear_square",
]

# The reach (κ, mm/MPa) of a path is a power of √2, at least this multiple of an estimate of κ. The
# estimate comes from the losses of the other patches and their pressures before use. The reach
# grows by up to this many powers if their losses require it. So the loss of a patch does not change
# its own steps, and most patches share a path.
_REACHES, _MORE = 1.25, 4
# Ratios of the coefficient of the interlayer to the coefficient of the bare stone.
_RATIOS = 0.0, 0.1, 0.3, 1.0, 3.0
_BODIES = "stone", "interlayer"
# Largest mean pressure of a patch, relative to the cap on the pressure of its elements.
_BORNE = 0.9

_PLACES = "x_mm", "y_mm", "rotation_deg"
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
    "reach_of_all": ("mm/MPa", "the same from the losses of all patches"),
    "measured": ("mm", "measured mean depth lost"),
    "pressure_MPa": ("MPa", "pressure before use, by the wear of the other patches"),
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

# The predictions: Archard's law and its variants.
BARE, INTERLAYER, CAPPED = "archard", "interlayer", "archard_capped"


class WornSquare(NamedTuple):
    """The path of wear of the square.

    Attributes
    ----------
    path : xarray.Dataset
        By ``reach``, the κ of the bare stone at the end, and ``ratio``, the interlayer's
        coefficient over the bare stone's (0 without an interlayer). ``kappa`` (reach, ratio, step):
        κ of both bodies together, mm/MPa, from 0 on. ``pressed`` (reach, ratio, body, step, patch):
        mean depth that one body alone would remove, mm. ``pressed_covered`` (reach, ratio, step,
        patch): depth by the stone over the area that both scans of a patch cover, which is the area
        of its measured loss. ``fitted`` (patch): κ of the bare stone from the measured losses of
        all other patches, and ``reach_of`` (patch): the path to this κ. ``kappa_of_all``,
        ``reach_of_all``: the same from all patches. ``measured`` (patch), mm, NaN if κ is not
        fitted to a patch; ``pressure_MPa`` before use and ``x_mm, y_mm, rotation_deg`` (patch);
        ``patch_mm``. The attribute ``wear_law`` has the fields of `law` for laws other than
        Archard's.
    interlayer : xarray.Dataset or None
        The layer that alternates with the bare stone: ``young`` (MPa), ``poisson``, ``thickness``
        (mm), and the ``pressure`` (y, x), MPa, under it on the square before use. Once it is
        fitted, it also contains its coefficient, from `gstlib.wear.interlayer.fit_interlayer`.
    """

    path: xr.Dataset
    interlayer: xr.Dataset | None

    @classmethod
    def from_datasets(cls, path: xr.Dataset, fitted: xr.Dataset | None) -> Self | None:
        """From the stored `path` and `interlayer`; None if wear is not predicted."""
        return cls(path, fitted) if path.sizes else None

    @property
    def law(self) -> Law:
        """The law of wear."""
        return Law(*self.path.attrs.get("wear_law", ARCHARD))

    @property
    def layer(self) -> Layer | None:
        """The interlayer as the solver takes it."""
        if self.interlayer is None:
            return None
        return Layer(*(float(self.interlayer[name]) for name in _OF_LAYER))

    def along(self, patch: str, ratio: float) -> xr.Dataset:
        """The path along which a patch wears, whose steps do not depend on its own loss."""
        at = self.path.sel(patch=patch, ratio=ratio)
        return at.sel(reach=float(at.reach_of))

    @property
    def fitted_to(self) -> list[str]:
        """The patches that κ is fitted to."""
        return self.path.patch.values[np.isfinite(self.path.measured.values)].tolist()


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
    """Wear the square, follow the pressures of the patches, and fit κ.

    Parameters
    ----------
    contact : Contact
        Contact of the face at the target load.
    pressures : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg`` and ``pressure_MPa`` before use of every patch. If a T1
        does not cover all of T0, also ``covered_MPa`` and the position of T1 from
        `gstlib.surfaces.footprints.with_t1`. With ``leave_one_out_MPa``, from
        `gstlib.use.outcome.pressures_of_use`, a patch wears at that pressure if it is known, so
        that its own loss does not influence it.
    losses_um : mapping
        Measured mean losses of the patches for the fit of κ, µm, finite; at least two.
    patch_mm : float
        Side of a patch.
    steps : int
        Implicit steps of the path.
    interlayer : gstlib.bem.Layer, optional
        Layer that alternates with the bare stone.
    gesture : Gesture, optional
        Each step removes material by the pressures and sliding of all poses, instead of the single
        pose. It excludes an interlayer.
    law : Law
        Law of wear of a patch. Other laws than Archard's exclude an interlayer and a gesture.

    Raises
    ------
    InputError
        The square cannot lose this much under these patches.
    """
    measured = pd.Series(losses_um, dtype=float) * 1e-3
    table = pressures.set_index("patch", drop=False)
    # An interlayer adds to the wear by the bare stone.
    ratios = _RATIOS if interlayer else _RATIOS[:1]
    # Over the outlines, then over the areas that both scans cover.
    areas = table[["patch", *_PLACES]], table
    means = scipy.sparse.vstack(
        [patch_means(contact.pressure, area, size_mm=patch_mm) for area in areas]
    )

    @cache
    def path_to(reach: float) -> xr.Dataset:
        paths = []
        for ratio in ratios:
            kappas = np.linspace(0, (1 + ratio) * reach, steps + 1)
            if gesture is None:
                pressed = _pressed(contact, means, kappas, ratio, interlayer)
            else:
                pressed = _pressed_in_poses(
                    contact, gesture, table, means, kappas, patch_mm
                )
            paths.append(_path(kappas, pressed, table))
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
        pressure_MPa=("patch", unseen(table)),  # for which κ was fitted
    )
    path = path.assign({name: ("patch", table[name]) for name in _PLACES})
    path = described(path, _DESCRIBED)
    if law != ARCHARD:
        path.attrs["wear_law"] = [*law]
    if interlayer is None:
        return WornSquare(path, None)
    return WornSquare(path, _before_use(contact, interlayer))


def wear_contact(contact: Contact, source: str, **options: Any) -> WearPath:
    """Wear the interface of a contact, with the `options` of `gstlib.bem.wear_path`."""
    path: WearPath = solve_again(contact, source, wear_path, **options)
    return path


def _before_use(contact: Contact, layer: Layer) -> xr.Dataset:
    """An interlayer, and the pressure (y, x) under it on the square before use, MPa."""
    mean_pressure = float(contact.pressure.mean())
    state = solve_again(contact, "macroscale", mean_pressure=mean_pressure, layer=layer)
    constants = xr.Dataset({name: getattr(layer, name) for name in _OF_LAYER})
    under = contact.pressure.copy(data=state.pressure)
    return described(constants, _OF_LAYER).assign(pressure=under)


def _pressed(
    contact: Contact,
    means: "scipy.sparse.csr_array",
    kappas: np.ndarray,
    ratio: float,
    interlayer: Layer | None,
) -> list:
    """Mean depths (step, area) by each body over the areas of `means`, after each step."""
    target = float(contact.pressure.mean())
    share = ratio / (1 + ratio)
    kappa, steps = kappas[-1], len(kappas) - 1
    path = wear_contact(
        contact,
        "macroscale",
        mean_pressure=target,
        mean_loss=kappa * target,
        steps=steps,
        third_body=ThirdBody(interlayer, share, target) if interlayer else None,
        keep_states=True,
    )
    pressed = []
    for states in zip(*path.states, strict=True):
        in_steps = [means @ state.pressure.ravel() for state in states]
        pressed.append(kappa / steps * np.cumsum(in_steps, axis=0))
    return pressed


def _pressed_in_poses(
    contact: Contact,
    gesture: Gesture,
    table: pd.DataFrame,
    means: "scipy.sparse.csr_array",
    kappas: np.ndarray,
    patch_mm: float,
) -> list:
    """Like `_pressed`, for all poses of a gesture in each of as many explicit steps.

    The exposure replaces the pressure, scaled so that its mean is the mean pressure.
    """
    target = float(contact.pressure.mean())
    height = contact.interface.height
    kappa, steps = kappas[-1], len(kappas) - 1
    in_steps = []
    for _ in range(steps):
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
        in_steps.append(means @ depth.ravel())
        height = height.copy(data=height.values - depth)
    return [np.cumsum(in_steps, axis=0)]


def _path(kappas: np.ndarray, depths: list, table: pd.DataFrame) -> xr.Dataset:
    """The path from mean depths (step, area) by body, over outlines, then over covered areas.

    Pressures are those under the load case inferred from the other patches.
    """
    # ASSUME: Change of pressure without a patch's own loss. The load case inferred from the other
    # patches changes the pressure over the outline as much as over the area that both scans cover.
    # Reason: T1 covers most of the outline.
    # ASSUME: Redistribution of pressure by wear. Wear changes the pressure of a patch as under the
    # load case inferred from all patches, down to zero. Reason: Otherwise each patch would need its
    # own path.
    # ASSUME: Remaining influence of a patch's own loss. The loss of a patch may influence its tilt,
    # its surroundings, and the pressures of the patches that κ is fitted to. Reason: Otherwise each
    # patch would need a path of its own.
    pressed = np.zeros((len(_BODIES), len(kappas), 2 * len(table)))
    pressed[: len(depths), 1:] = depths
    other = (unseen(table) - covered(table)).to_numpy()
    if other.any():
        added = np.diff(kappas)[:, np.newaxis] * np.tile(other, 2)
        steps = np.maximum(np.diff(pressed, axis=1) + added, 0)
        pressed[:, 1:] = np.cumsum(steps, axis=1)
    outlines, areas = np.split(pressed, 2, axis=-1)
    return xr.Dataset(
        {
            "kappa": ("step", kappas),
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
    """The κ at which the patches of `measured` have lost this sum, and the end of its path."""
    patches, total = list(measured.index), measured.sum()
    equivalent = pd.Series(law.equivalent(pressures.to_numpy()), pressures.index)
    start = _REACHES * total / equivalent[patches].sum()
    first = math.ceil(2 * math.log2(start))
    for power in range(first, first + _MORE + 1):
        reach = 2.0 ** (power / 2)
        path = path_to(reach).sel(ratio=0)
        pressed, kappa = path.pressed_covered, path.kappa.values
        removed = _removed(pressed.values, kappa, law, pressures.to_numpy())
        lost = pressed.copy(data=removed).sel(patch=patches).sum("patch").values
        if total <= lost[-1]:
            return float(np.interp(total, lost, kappa)), reach
    raise InputError(
        "macroscale",
        "the measured losses are more than this square can lose under its patches",
        "Look for a patch whose T1 is wrong.",
    )


def _removed(
    pressed: np.ndarray, kappa: np.ndarray, law: Law, before: np.ndarray
) -> np.ndarray:
    """Depth (steps, …) that a law removes at pressures at which Archard's law removes `pressed`.

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
    """The visible part of a lost depth: T1 is registered to T0 at the level of most points."""
    return depth - np.median(depth)


def wear_patch(
    contact: Contact,
    worn: WornSquare,
    patch: str,
    *,
    ratio: float = 0.0,
    kappa: float | None = None,
    pressure_cap: float | None = None,
) -> list[np.ndarray]:
    """Wear a patch at the pressures that it has on the wearing square.

    Parameters
    ----------
    contact : Contact
        Contact of the patch before use.
    worn : WornSquare
    patch : str
    ratio : float
        A ratio of `worn`.
    kappa : float, optional
        κ in mm/MPa; by default, the κ of the bare stone from the other patches.
    pressure_cap : float, optional
        Cap on the pressure of an element. It moves wear within the patch. The loss of the patch
        depends only on its mean pressure, which is at most nine tenths of the cap.

    Returns
    -------
    list of ndarray, shape (ny, nx)
        The depth lost, mm, without a cap and, if there is one, with it.
    """
    at, source = worn.along(patch, ratio), f"patch {patch}"
    kappa = float(at.fitted) if kappa is None else kappa
    lost, options = driven(contact, worn, at, kappa)
    if not lost > 0:
        none = np.zeros(contact.pressure.shape)
        return [none] if pressure_cap is None else [none, none]
    elastic = wear_contact(contact, source, **options)
    if pressure_cap is None:
        return [elastic.depth]
    most = _BORNE * pressure_cap * contact.interface.covered
    bounded = _bounded(options, pressure_cap, most, worn.law)
    # If no pressure reaches the cap, the contacts are the same as without it.
    is_borne = math.isclose(bounded["mean_loss"], lost, rel_tol=1e-12)
    if is_borne and elastic.highest_pressure < pressure_cap:
        return [elastic.depth, elastic.depth]
    return [elastic.depth, wear_contact(contact, source, **bounded).depth]


def driven(
    contact: Contact, worn: WornSquare, at: xr.Dataset, kappa: float
) -> tuple[float, dict]:
    """Mean loss (mm) of a patch at a κ, and the settings of `wear_path` that lead to it.

    `at` is the path of the square for one reach and one ratio.
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
    if ratio and worn.layer and worn.interlayer is not None:
        lowered = _lowered(contact, at, worn.layer, worn.interlayer.pressure)
        options["third_body"] = ThirdBody(worn.layer, share, soft, lowered)
    return lost, options


def _bounded(options: dict, pressure_cap: float, most: float, law: Law) -> dict:
    """The settings of `driven` with a cap on the pressure, at mean pressures of at `most` MPa."""
    stone = np.minimum(options["mean_pressure"], most)
    bounded = options | {"mean_pressure": stone, "pressure_cap": pressure_cap}
    if (body := options.get("third_body")) is not None:
        soft = np.minimum(body.mean_pressure, most)
        bounded["third_body"] = replace(body, mean_pressure=soft)
    borne, asked = _rate(bounded, law), _rate(options, law)
    return bounded | {"mean_loss": options["mean_loss"] * borne / asked}


def _rate(options: dict, law: Law) -> float:
    """Rate of wear by both bodies under the settings of `driven`, up to a coefficient."""
    body, rate = options.get("third_body"), law.rate(options["mean_pressure"]).sum()
    if body is None:
        return float(rate)
    return float((1 - body.share) * rate + body.share * body.mean_pressure.sum())


def _lowered(
    contact: Contact, at: xr.Dataset, layer: Layer, pressure: xr.DataArray
) -> np.ndarray | float:
    """Additional depth (mm) of a patch's surroundings under an interlayer at its pressure."""
    around = contact.interface.surroundings
    if around is None:
        return 0.0
    under_interlayer = surroundings(
        pressure,
        PatchPosition.from_dataset(at),
        around.shape,
        size_mm=float(at.patch_mm),
        contact_modulus_MPa=contact.modulus,
        layer=layer,
    )
    return under_interlayer - around
