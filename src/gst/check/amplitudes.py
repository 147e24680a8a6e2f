"""Are all heights in one unit? A correlation ignores their scale; their amplitudes do not.

The amplitude of a scan is compared with the amplitudes of the other scans. In the waves that the
mesh resolves, it is also compared with the mesh. A patch that use has polished is smooth beside
the others, but as high as the mesh under it in those waves. On the files at hand, generated and
measured, neither ratio is further than a factor of two from the ratio of the other patches.
"""

import logging
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from skimage.transform import resize_local_mean

from gst.check.sliding import sides_of
from gstlib.coupling.comparison import WAVE_PER_EDGE
from gstlib.errors import NOTE, FaultError
from gstlib.io.scans import unit_remedy
from gstlib.surfaces.footprints import PatchPosition, on_patch, spline_of
from gstlib.surfaces.grid import MM_TO_UM, make_surface
from gstlib.surfaces.leveling import remove_plane

_log = logging.getLogger(__name__)

WRONG_UNIT = "units"  # the fault's name, as which a config accepts it
# ASSUME: Factor between units. Heights of one stone that differ by a factor of 10 are in different
# units. Two scans of a patch are compared, or scans and mesh in the waves that both resolve.
# Reason: Units differ by a factor of 10 or more. A smaller factor may be a calibration.
UNIT_FACTOR = 10.0
# Where the mesh sees no waves of a patch, polish could be mistaken for a unit: only this is none.
_FACTOR_UNSEEN = 100.0
# This factor may be a calibration.
_ODD_FACTOR = 4.0
# Fewest blocks along a patch's side: 2 × 2 blocks leave one degree of freedom after levelling.
_FEWEST_BLOCKS = 2


class Amplitude(NamedTuple):
    """How high a scan is."""

    path: Path
    # How much heights vary over an eighth of the scan (mm), regardless of tilt and spikes.
    spread: float
    # R.m.s. heights (mm) of the scan and of the mesh under it, in waves that the mesh's edges
    # resolve; None if these are longer than the scan.
    waves: tuple[float, float] | None = None
    states_unit: bool = False  # the file, so that the config has no effect on it

    @classmethod
    def measured(
        cls,
        path: Path,
        scan: xr.DataArray,
        square: xr.DataArray | None,
        place: PatchPosition | None,
    ) -> "Amplitude":
        """That of a scan at a place of the square, if it has one; `square` is the mesh's."""
        apart = max(1, scan.shape[1] // 8)
        steps = scan.values[:, apart:] - scan.values[:, :-apart]
        spread = float(np.subtract(*np.nanpercentile(steps, [75, 25])))
        waves = None
        if square is not None and place is not None:
            waves = _common_waves(scan, square, place)
        return cls(path, spread, waves, scan.attrs.get("unit_stated") == "yes")


def _common_waves(
    scan: xr.DataArray, square: xr.DataArray, place: PatchPosition
) -> tuple[float, float] | None:
    side = min(sides_of(scan))
    blocks = int(2 * side / (WAVE_PER_EDGE * square.attrs["mesh_edge_mm"]))
    if blocks < _FEWEST_BLOCKS:
        return None
    level = remove_plane(scan)[0].fillna(0.0).values
    under = on_patch(spline_of(square), place, scan.shape, side)

    def height(values: np.ndarray) -> float:
        means = resize_local_mean(values, (blocks, blocks))
        return float(remove_plane(make_surface(means, side / blocks))[0].std())

    return height(level), height(under)


def other_units(
    at_t0: Mapping[str, Amplitude], mesh_edge_mm: float | None
) -> Iterator[FaultError]:
    """Scans with heights in another unit than the other scans, or all than the mesh.

    A lesser difference is logged as a warning, a mesh whose edges are too long to tell as a note.
    They are None without a mesh.
    """
    alone = [fault for patch in at_t0 for fault in _unlike_others(patch, at_t0)]
    yield from alone
    waves = [amplitude.waves for amplitude in at_t0.values() if amplitude.waves]
    remedy = unit_remedy(all(amplitude.states_unit for amplitude in at_t0.values()))
    if at_t0 and mesh_edge_mm and not waves:
        # Bounds alone do not suffice, because polish could be mistaken for a unit.
        _log.log(
            NOTE,
            "scans: the unit of all heights could not be checked, because a mesh with edges of "
            "%.3g mm does not show waves of a patch. Compare their range with the range on the "
            "instrument. If it differs: %s",
            mesh_edge_mm,
            remedy,
        )
    if alone or not waves:
        return
    scan, mesh = np.sqrt(np.square(waves).mean(axis=0))
    if max(scan, mesh) > UNIT_FACTOR * min(scan, mesh):
        yield FaultError(
            WRONG_UNIT,
            "scans",
            f"in the waves that scans and mesh both resolve, the scans are {scan * MM_TO_UM:.3g} "
            f"µm high (r.m.s.) and the mesh under them {mesh * MM_TO_UM:.3g} µm",
            f"{remedy} Check inputs.mesh_unit, too. If both units are right, the mesh does not "
            "show how the patches lie: set coupling to paper.",
        )


def _unlike_others(patch: str, at_t0: Mapping[str, Amplitude]) -> Iterator[FaultError]:
    """The fault of one patch, if its heights are of another order than those of all others."""
    own = at_t0[patch]
    # of two, each is compared with the other; of more, the median is not moved by one
    spreads = [
        other.spread for name, other in at_t0.items() if name != patch or len(at_t0) > 2
    ]
    if not own.spread or not spreads or not (usual := float(np.median(spreads))):
        return
    factor, (scan, mesh) = own.spread / usual, own.waves or (0.0, 0.0)
    off, unit = abs(math.log(factor)), math.log(_FACTOR_UNSEEN)
    if scan and mesh:
        same_way = math.log(scan / mesh) * math.copysign(1.0, math.log(factor))
        off, unit = min(off, same_way), math.log(UNIT_FACTOR)
    fault = FaultError(
        WRONG_UNIT,
        own.path,
        f"its heights (patch {patch}) vary {factor:.3g} times as much as on the other "
        "patches" + (", and do not fit the mesh under it" if scan and mesh else ""),
        f"Export all scans in one unit and with one calibration. {unit_remedy(own.states_unit)}",
        [patch],
    )
    if off > unit:
        yield fault
    elif off > math.log(_ODD_FACTOR):
        _log.warning("%s: %s. %s", fault.source, fault.problem, fault.remedy)
