"""Registration of T1 to T0: gstlib compared with a library, on scans with known truth.

    uv run --with scikit-image --with simpleitk \
        python benchmarks/registration.py --cases 8 --output benchmarks/results/registration.csv

SimpleITK was the most accurate of the libraries that were tried. It starts from the coarse shift
of scikit-image's masked correlation over the overlap. It runs on band-passed heights, and then
three times without the points where heights disagree (worn, spikes). A library that is not
installed is left out, and a line says so. The error is the distance, in points, by which the
centre of T1 is misplaced, and the error of the rotation. A pair counts as lost from half a point.
`--cases` is the number of pairs for each condition.
"""

import math
import time
from functools import partial
from importlib.util import find_spec
from itertools import product

import numpy as np
import pandas as pd
import scipy.ndimage
from runner import RESULTS, run_script
from skimage.registration import phase_cross_correlation

from gstlib.change.registration import register
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane

# Points along a side, and their distance, mm.
SIZE, SPACING = 512, 1.66e-3
NOISE = 0.1e-3  # mm
# Farthest shift, as a share of the field, and largest turn, degrees.
SHIFT, TURN = 0.2, 2.0
CONDITIONS = {
    "noise": {},
    "wear": {"wear": 0.3},
    "outliers": {"spikes": 0.005},
    "tilt": {"tilt": 5e-3},
    "all": {"wear": 0.3, "spikes": 0.005, "tilt": 5e-3},
}
# Band of the detail, points: gstlib's own, for the coarse step of the libraries as well.
BAND = (1.5, 21.0)
LOST = 0.5
# How often SimpleITK runs without the points that disagree.
STEPS = 3


def scans(place, seed, *, wear=0.0, spikes=0.0, tilt=1e-3):
    """T0 and T1 (mm) of one stone: a self-affine field with a roll-off, its highest part worn.

    `place` is that of T1 on T0, in points from its centre, here and in all that follows.
    """
    rng = np.random.default_rng(seed)
    whole = 2 * SIZE
    wave = np.hypot(*np.meshgrid(*[np.fft.fftfreq(whole) * whole] * 2, indexing="ij"))
    amplitude = np.where(wave > 0, np.maximum(wave, 6) ** -1.8, 0) * (wave < whole / 4)
    stone = np.fft.ifft2(
        np.fft.fft2(rng.standard_normal((whole, whole))) * amplitude
    ).real
    stone *= 5e-3 / stone.std()
    middle = slice((whole - SIZE) // 2, (whole + SIZE) // 2)
    top = np.quantile(stone[middle, middle], 1 - wear)
    worn = np.minimum(stone, top + 0.2 * (stone - top))
    v, u = np.indices((SIZE, SIZE)) - (SIZE - 1) / 2
    at = np.array(place.points(v, u)) + (whole - 1) / 2
    after = scipy.ndimage.map_coordinates(worn, at, order=3)
    after += tilt * SPACING * (u - 0.5 * v)
    epochs = []
    for heights in (stone[middle, middle], after):
        measured = heights + NOISE * rng.standard_normal(heights.shape)
        spike = rng.random(heights.shape) < spikes
        measured += spike * rng.uniform(5e-3, 30e-3, heights.shape)
        epochs.append(remove_plane(make_surface(measured, SPACING))[0].values)
    return epochs


def gstlib_register(t0, t1):
    """The project's own."""
    match = register(
        make_surface(t0, SPACING),
        make_surface(t1, SPACING),
        maximum_shift_mm=0.3 * len(t0) * SPACING,
    )
    shift = match.shift_y_mm / SPACING, match.shift_x_mm / SPACING
    return PatchPosition(*shift, match.rotation_deg)


def detail(heights):
    """Band-passed heights, clipped at three robust deviations."""
    low, high = (scipy.ndimage.gaussian_filter(heights, sigma) for sigma in BAND)
    band = low - high
    bound = 3 * 1.4826 * np.median(np.abs(band))
    return np.clip(band, -bound, bound)


def masked_correlation(t0, t1):
    """scikit-image: the whole-point shift at the peak of the correlation over the overlap."""
    factor = max(1, len(t0) // 256)
    coarse0, coarse1 = (detail(h)[::factor, ::factor] for h in (t0, t1))
    everywhere = np.ones(coarse0.shape, dtype=bool)
    shift, _, _ = phase_cross_correlation(
        coarse0,
        coarse1,
        reference_mask=everywhere,
        moving_mask=everywhere,
        overlap_ratio=0.3,
    )
    return PatchPosition(*(factor * shift))


def smooth(heights):
    """Clipped, so that no spike rules, and smoothed over a point."""
    bound = 4 * 1.4826 * np.median(np.abs(heights - np.median(heights)))
    return scipy.ndimage.gaussian_filter(np.clip(heights, -bound, bound), 1.0)


def settled(t0, t1, place):
    """T1 with the plane of what did not change taken off, and the mask of that on T0's grid."""
    centre = (SIZE - 1) / 2
    # from the centre of T1, about which the plane is taken off
    seen = np.array(place.seen(*np.indices(t0.shape) - centre))
    moved = scipy.ndimage.map_coordinates(t1, seen + centre, order=1, cval=np.nan)
    inside = np.isfinite(moved)
    left = (moved - t0)[inside]
    design = np.column_stack([np.ones(left.size), *seen[:, inside]])
    plane = np.array([np.median(left), 0.0, 0.0])
    for _ in range(10):
        off = left - design @ plane
        off -= np.median(off)
        kept = np.abs(off) < 3 * 1.4826 * np.median(np.abs(off))
        plane = np.linalg.lstsq(design[kept], left[kept], rcond=None)[0]
    mask = np.zeros(t0.shape, dtype=np.uint8)
    mask[inside] = kept
    rows, columns = np.indices(t1.shape) - centre
    return t1 - plane[0] - plane[1] * rows - plane[2] * columns, mask


def simpleitk(t0, t1):
    """SimpleITK: Euler transform; correlation of the detail, then trimmed least squares."""
    import SimpleITK as sitk  # noqa: N813

    centre = (SIZE - 1) / 2
    place = masked_correlation(t0, t1)
    for factors in ([4, 2, 1], *STEPS * [[1]]):
        method = sitk.ImageRegistrationMethod()
        if len(factors) > 1:
            images = detail(t0), detail(t1)
            method.SetMetricAsCorrelation()
            method.SetInterpolator(sitk.sitkLinear)
        else:
            flat, mask = settled(t0, t1, place)
            images = smooth(t0), smooth(flat)
            method.SetMetricAsMeanSquares()
            method.SetInterpolator(sitk.sitkBSpline3)
            method.SetMetricFixedMask(sitk.GetImageFromArray(mask))
        shift = np.array([place.x_mm, place.y_mm])
        transform = sitk.Euler2DTransform()
        # about the point that lies on T1's centre, so that shift and turn do not couple
        transform.SetCenter(centre + shift)
        transform.SetAngle(-math.radians(place.rotation_deg))
        transform.SetTranslation((-shift).tolist())
        method.SetShrinkFactorsPerLevel(factors)
        method.SetSmoothingSigmasPerLevel([f / 2 if f > 1 else 0 for f in factors])
        method.SetOptimizerAsRegularStepGradientDescent(1.0, 1e-4, 200, 0.6)
        method.SetOptimizerScalesFromPhysicalShift()
        method.SetInitialTransform(transform, inPlace=True)
        # in µm
        method.Execute(*(sitk.GetImageFromArray(1e3 * image) for image in images))
        x, y = transform.GetInverse().TransformPoint((centre, centre))
        turn = -math.degrees(transform.GetAngle())
        place = PatchPosition(y - centre, x - centre, turn)
    return place


METHODS = {
    "gstlib": gstlib_register,
    "scikit-image, masked": masked_correlation,
    "SimpleITK": simpleitk,
}


def measure(label, method, condition, case):
    """One pair of scans, laid by chance; the same for every method."""
    rng = np.random.default_rng([case, *condition.encode()])
    way, share, turn_deg = rng.uniform([0, 0, -TURN], [2 * math.pi, SHIFT, TURN])
    shift = share * SIZE * np.array([math.sin(way), math.cos(way)])
    true = PatchPosition(*shift, turn_deg)
    t0, t1 = scans(true, case, **CONDITIONS[condition])
    row = {"method": label, "condition": condition}
    start = time.process_time()
    try:
        place = method(t0, t1)
    except Exception as failure:  # whatever a library raises where it does not converge
        print(f"{label}, {condition}, case {case}: {failure}")
        place = PatchPosition(np.inf, np.inf, np.inf)
    row["cpu_s"] = time.process_time() - start
    *off, turn_deg = np.subtract(place, true)
    row["error_points"] = float(np.hypot(*off))
    row["turn_error_deg"] = abs(turn_deg)
    return row


def summary(table):
    """Median and largest error, how often it is small, and the time, by method and condition."""
    whole = table.assign(condition="of all")
    groups = pd.concat([table, whole]).groupby(["method", "condition"], sort=False)
    errors = groups.error_points
    p95 = partial(np.quantile, q=0.95, method="inverted_cdf")
    columns = {
        "cases": errors.size(),
        "error_median_points": errors.median(),
        "error_p95_points": errors.apply(p95),
        "error_largest_points": errors.max(),
        "within_a_fifth": errors.apply(lambda error: (error < 0.2).mean()),
        "lost": errors.apply(lambda error: (error >= LOST).mean()),
        "turn_error_median_deg": groups.turn_error_deg.median(),
        "cpu_s_median": groups.cpu_s.median(),
    }
    return pd.DataFrame(columns).reset_index()


def made(chosen):
    """The summary of all pairs."""
    rows = []
    for label, method in METHODS.items():
        if method is simpleitk and find_spec(label) is None:
            print(f"{label}: not available")
            continue
        for name, case in product(CONDITIONS, range(chosen.cases)):
            rows.append(measure(label, method, name, case))
        print(f"{label}: done", flush=True)
    yield summary(pd.DataFrame(rows))


if __name__ == "__main__":
    run_script(
        __doc__,
        RESULTS / "registration.csv",
        made,
        lambda rows: rows.to_string(index=False),
        digits=3,
        cases=10,
    )
