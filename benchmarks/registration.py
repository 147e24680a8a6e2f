"""Registration of T1 to T0: gstlib compared with a library, on scans with known truth.

    uv run --with scikit-image --with simpleitk \
        python benchmarks/registration.py --cases 8 --output benchmarks/results/registration.csv

SimpleITK was the most accurate of the libraries that were tried. It starts from the coarse shift
of scikit-image's masked correlation over the overlap. It runs on band-passed heights, and then
three times without the points where heights disagree (worn, spikes). A library that is not
installed is left out, and a line says so. The error is the distance, in points, by which the
centre of T1 is misplaced, and the error of the rotation. A pair counts as lost from half a point.
"""

import math
import time
from functools import partial
from importlib.util import find_spec
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy.ndimage
from runner import RESULTS, options, save
from skimage.registration import phase_cross_correlation
from skimage.transform import EuclideanTransform

from gstlib.change.registration import register
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane

# Points along a side, and their distance, mm.
SIZE, SPACING = 512, 1.66e-3
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


class Pose(NamedTuple):
    """Where T1 lies on T0: shift (rows, columns) of its centre in points, turn in radians."""

    shift: np.ndarray
    turn: float


def scans(size, *, shift, turn, seed, wear=0.0, spikes=0.0, tilt=1e-3, noise=0.1e-3):
    """T0 and T1 (mm) of one stone: a self-affine field with a roll-off, its highest part worn."""
    rng = np.random.default_rng(seed)
    whole = 2 * size
    wave = np.hypot(*np.meshgrid(*[np.fft.fftfreq(whole) * whole] * 2, indexing="ij"))
    amplitude = np.where(wave > 0, np.maximum(wave, 6) ** -1.8, 0) * (wave < whole / 4)
    stone = np.fft.ifft2(
        np.fft.fft2(rng.standard_normal((whole, whole))) * amplitude
    ).real
    stone *= 5e-3 / stone.std()
    middle = slice((whole - size) // 2, (whole + size) // 2)
    top = np.quantile(stone[middle, middle], 1 - wear)
    worn = np.minimum(stone, top + 0.2 * (stone - top))
    v, u = np.indices((size, size)) - (size - 1) / 2
    rows = np.cos(turn) * v + np.sin(turn) * u + shift[0] + (whole - 1) / 2
    columns = np.cos(turn) * u - np.sin(turn) * v + shift[1] + (whole - 1) / 2
    after = scipy.ndimage.map_coordinates(worn, [rows, columns], order=3)
    after += tilt * SPACING * (u - 0.5 * v)
    epochs = []
    for heights in (stone[middle, middle], after):
        measured = heights + noise * rng.standard_normal(heights.shape)
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
    shift = np.array([match.shift_y_mm, match.shift_x_mm]) / SPACING
    return Pose(shift, math.radians(match.rotation_deg))


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
    return Pose(factor * np.asarray(shift, dtype=float), 0.0)


def from_matrix(matrix, centre):
    """Pose from the matrix (x, y, 1) of T0's points to T1's."""
    x, y = EuclideanTransform(matrix).inverse([centre, centre])[0] - centre
    return Pose(np.array([y, x]), math.atan2(matrix[0, 1], matrix[0, 0]))


def to_matrix(pose, centre):
    """Matrix (x, y, 1) of T0's points to T1's."""
    turned = EuclideanTransform(rotation=-pose.turn)
    moved = EuclideanTransform(translation=-centre - pose.shift[::-1])
    back = EuclideanTransform(translation=[centre, centre])
    return (moved + turned + back).params


def smooth(heights):
    """Clipped, so that no spike rules, and smoothed over a point."""
    bound = 4 * 1.4826 * np.median(np.abs(heights - np.median(heights)))
    return scipy.ndimage.gaussian_filter(np.clip(heights, -bound, bound), 1.0)


def settled(t0, t1, pose):
    """T1 with the plane of what did not change taken off, and the mask of that on T0's grid."""
    centre = (len(t1) - 1) / 2
    matrix = to_matrix(pose, centre)
    v, u = np.indices(t0.shape)
    x, y, _ = np.einsum("ij,jkl->ikl", matrix, np.stack([u, v, np.ones(u.shape)]))
    moved = scipy.ndimage.map_coordinates(t1, [y, x], order=1, cval=np.nan)
    inside = np.isfinite(moved)
    left = (moved - t0)[inside]
    # in T1's coordinates, where the plane is taken off
    along = np.stack([y[inside] - centre, x[inside] - centre], axis=1)
    design = np.column_stack([np.ones(left.size), along])
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


def refined(t0, t1, step, stages):
    """The pose after steps with a library, from the coarse shift.

    Each stage has an option of the library, and whether the heights are compared without the
    points that disagree; otherwise the detail is. ``step(pose, images, mask, option)`` returns a
    matrix; the mask, on the grid of T0, is missing where all points count. Heights are in µm.
    """
    pose = masked_correlation(t0, t1)
    for option, is_trimmed in stages:
        images, mask = (detail(t0), detail(t1)), None
        if is_trimmed:
            flat, mask = settled(t0, t1, pose)
            images = smooth(t0), smooth(flat)
        matrix = step(pose, [1e3 * image for image in images], mask, option)
        pose = from_matrix(matrix, (len(t1) - 1) / 2)
    return pose


def simpleitk(t0, t1):
    """SimpleITK: Euler transform; correlation of the detail, then trimmed least squares."""
    import SimpleITK as sitk  # noqa: N813

    def step(pose, images, mask, factors):
        a, b = map(sitk.GetImageFromArray, images)
        transform = sitk.Euler2DTransform()
        # about the point that lies on T1's centre, so that shift and turn do not couple
        transform.SetCenter((len(t1) - 1) / 2 + pose.shift[::-1])
        transform.SetAngle(-pose.turn)
        transform.SetTranslation((-pose.shift[::-1]).tolist())
        method = sitk.ImageRegistrationMethod()
        method.SetShrinkFactorsPerLevel(factors)
        method.SetSmoothingSigmasPerLevel([f / 2 if f > 1 else 0 for f in factors])
        method.SetOptimizerAsRegularStepGradientDescent(1.0, 1e-4, 200, 0.6)
        method.SetOptimizerScalesFromPhysicalShift()
        method.SetInitialTransform(transform, inPlace=True)
        if mask is None:
            method.SetMetricAsCorrelation()
            method.SetInterpolator(sitk.sitkLinear)
        else:
            method.SetMetricAsMeanSquares()
            method.SetInterpolator(sitk.sitkBSpline3)
            method.SetMetricFixedMask(sitk.GetImageFromArray(mask))
        method.Execute(a, b)
        at = np.array([transform.TransformPoint(p) for p in ((0, 0), (1, 0), (0, 1))])
        matrix = np.eye(3)
        matrix[:2] = np.column_stack([at[1] - at[0], at[2] - at[0], at[0]])
        return matrix

    stages = [([4, 2, 1], False), ([1], True), ([1], True), ([1], True)]
    return refined(t0, t1, step, stages)


METHODS = {
    "gstlib": (gstlib_register, "gstlib"),
    "scikit-image, masked": (masked_correlation, "skimage"),
    "SimpleITK": (simpleitk, "SimpleITK"),
}


def main():
    cases = {"type": int, "default": 10, "help": "pairs of scans a condition"}
    chosen = options(__doc__, RESULTS / "registration.csv", cases=cases)
    if not chosen.tables:
        rows = []
        for label, (method, module) in METHODS.items():
            if find_spec(module) is None:
                print(f"{label}: not available")
                continue
            for name, case in product(CONDITIONS, range(chosen.cases)):
                rows.append(measure(label, method, name, case))
            print(f"{label}: done", flush=True)
        save(chosen.output, summary(pd.DataFrame(rows)), digits=3)
    print(pd.read_csv(chosen.output).to_string(index=False))


def measure(label, method, condition, case):
    """One pair of scans, laid by chance; the same for every method."""
    rng = np.random.default_rng([case, *condition.encode()])
    way, share, turn_deg = rng.uniform([0, 0, -TURN], [2 * math.pi, SHIFT, TURN])
    shift = share * SIZE * np.array([math.sin(way), math.cos(way)])
    turn = math.radians(turn_deg)
    t0, t1 = scans(SIZE, shift=shift, turn=turn, seed=case, **CONDITIONS[condition])
    row = {"method": label, "condition": condition}
    start = time.process_time()
    try:
        pose = method(t0, t1)
    except Exception as failure:  # whatever a library raises where it does not converge
        print(f"{label}, {condition}, case {case}: {failure}")
        pose = Pose(np.full(2, np.inf), np.inf)
    row["cpu_s"] = time.process_time() - start
    row["error_points"] = float(np.hypot(*(pose.shift - shift)))
    row["turn_error_deg"] = math.degrees(abs(pose.turn - turn))
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


if __name__ == "__main__":
    main()
