"""Registration of T1 to T0: gstlib's against well-kept libraries, on scans with known truth.

    uv run --with scikit-image --with simpleitk --with pystackreg --with opencv-python-headless \
        python benchmarks/registration.py --cases 8 --output benchmarks/results/registration.csv

Each library gets what it asks for: band-passed heights, the coarse shift found by scikit-image's
masked correlation over the overlap, a plane taken off; those that take a mask are run again
without the points where heights disagree (worn, spikes), three times. A library that is not there
is left out, with a line that says so. The error is the distance, in points, by which the centre of
T1 is misplaced, and the turn; a pair counts as lost from half a point on.
"""

import math
import time
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy.ndimage
from runner import RESULTS, options, save

from gstlib.change.registration import register
from gstlib.surfaces.grid import make_surface

SPACING = 1.66e-3
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
        epochs.append(level(measured + spike * rng.uniform(5e-3, 30e-3, heights.shape)))
    return epochs


def level(heights):
    """Heights less their least-squares plane."""
    y, x = np.indices(heights.shape).reshape(2, -1) / len(heights) - 0.5
    design = np.stack([np.ones(y.size), y, x], axis=1)
    plane = np.linalg.lstsq(design, heights.ravel(), rcond=None)[0]
    return heights - (design @ plane).reshape(heights.shape)


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
    from skimage.registration import phase_cross_correlation

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


def upsampled_correlation(t0, t1):
    """scikit-image: then the phase correlation of the common part, upsampled a hundredfold."""
    from skimage.registration import phase_cross_correlation

    shift = masked_correlation(t0, t1).shift.astype(int)
    for _ in range(3):
        part0, part1 = common(detail(t0), detail(t1), shift)
        window = np.outer(np.hanning(part0.shape[0]), np.hanning(part0.shape[1]))
        fine, _, _ = phase_cross_correlation(
            part0 * window, part1 * window, upsample_factor=100, normalization=None
        )
        step = np.rint(fine).astype(int)
        if not step.any():
            break
        shift = shift + step
    return Pose(shift + fine - step, 0.0)


def common(a, b, shift):
    """The parts of both that lie on each other, `b` shifted by whole points."""
    first = np.maximum(shift, 0)
    last = np.minimum(a.shape, np.asarray(b.shape) + shift)
    of_a = tuple(slice(i, j) for i, j in zip(first, last, strict=True))
    of_b = tuple(slice(i, j) for i, j in zip(first - shift, last - shift, strict=True))
    return a[of_a], b[of_b]


def from_matrix(matrix, centre):
    """Pose from the matrix (x, y, 1) of T0's points to T1's."""
    centre = np.array([centre, centre, 1.0])
    x, y, _ = np.linalg.solve(matrix, centre) - centre
    return Pose(np.array([y, x]), math.atan2(matrix[0, 1], matrix[0, 0]))


def to_matrix(pose, centre):
    """Matrix (x, y, 1) of T0's points to T1's."""
    cosine = math.cos(pose.turn)
    sine = math.sin(pose.turn)
    matrix = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    y, x = pose.shift
    matrix[:2, 2] = centre - matrix[:2, :2] @ [centre + x, centre + y]
    return matrix


def stackreg(t0, t1):
    """pystackreg (TurboReg): rigid body, from the coarse shift."""
    from pystackreg import StackReg

    start = masked_correlation(t0, t1).shift.astype(int)
    side = min(size - abs(s) for size, s in zip(t0.shape, start, strict=True))
    part0, part1 = (
        part[:side, :side] for part in common(smooth(t0), smooth(t1), start)
    )
    matrix = np.asarray(StackReg(StackReg.RIGID_BODY).register(part0, part1))
    first0 = np.maximum(start, 0)
    first1 = np.maximum(-start, 0)
    of_t0 = np.eye(3)
    of_t1 = np.eye(3)
    of_t0[:2, 2], of_t1[:2, 2] = -first0[::-1], first1[::-1]
    return from_matrix(of_t1 @ matrix @ of_t0, (len(t1) - 1) / 2)


def smooth(heights):
    """Clipped, so that no spike rules, and smoothed over a point."""
    bound = 4 * 1.4826 * np.median(np.abs(heights - np.median(heights)))
    return scipy.ndimage.gaussian_filter(np.clip(heights, -bound, bound), 1.0)


def settled(t0, t1, pose):
    """T1 with the plane of what did not change taken off, and the mask of that on T0's grid."""
    centre = (len(t1) - 1) / 2
    v, u = np.indices(t0.shape)
    matrix = to_matrix(pose, centre)
    x, y, _ = np.einsum("ij,jkl->ikl", matrix, np.stack([u, v, np.ones(u.shape)]))
    moved = scipy.ndimage.map_coordinates(t1, [y, x], order=1, cval=np.nan)
    inside = np.isfinite(moved)
    left = (moved - t0)[inside]
    # in T1's coordinates, where the plane is taken off
    design = np.stack(
        [np.ones(left.size), y[inside] - centre, x[inside] - centre], axis=1
    )
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


def ecc(t0, t1):
    """OpenCV: enhanced correlation coefficient, Euclidean motion, trimmed."""
    import cv2

    pose = masked_correlation(t0, t1)
    centre = (len(t1) - 1) / 2
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-7)
    # the detail, from smooth to fine; then the heights, without what disagrees
    for smoothing, trim in ((13, False), (5, False), (5, True), (5, True), (5, True)):
        warp = to_matrix(pose, centre)[:2].astype(np.float32)
        if trim:
            flat, mask = settled(t0, t1, pose)
            a, b = (smooth(h) * 1e3 for h in (t0, flat))
            # OpenCV's mask is one of the moving image
            mask = cv2.warpAffine(mask, warp, b.shape[::-1], flags=cv2.INTER_NEAREST)
        else:
            a = detail(t0) * 1e3
            b = detail(t1) * 1e3
            mask = np.ones(t1.shape, dtype=np.uint8)
        a = a.astype(np.float32)
        b = b.astype(np.float32)
        _, warp = cv2.findTransformECC(
            a, b, warp, cv2.MOTION_EUCLIDEAN, stop, mask, smoothing
        )
        pose = from_matrix(np.vstack([warp, [0, 0, 1]]).astype(float), centre)
    return pose


def simpleitk(t0, t1):
    """SimpleITK: Euler transform; correlation of the detail, then trimmed least squares."""
    import SimpleITK as sitk  # noqa: N813

    pose = masked_correlation(t0, t1)
    centre = (len(t1) - 1) / 2
    for factors, trim in (([4, 2, 1], False), ([1], True), ([1], True), ([1], True)):
        transform = sitk.Euler2DTransform()
        # about the point that lies on T1's centre, so that shift and turn do not couple
        transform.SetCenter([centre + pose.shift[1], centre + pose.shift[0]])
        transform.SetAngle(-pose.turn)
        transform.SetTranslation((-pose.shift[::-1]).tolist())
        method = sitk.ImageRegistrationMethod()
        method.SetShrinkFactorsPerLevel(factors)
        method.SetSmoothingSigmasPerLevel([f / 2 if f > 1 else 0 for f in factors])
        method.SetOptimizerAsRegularStepGradientDescent(1.0, 1e-4, 200, 0.6)
        method.SetOptimizerScalesFromPhysicalShift()
        method.SetInitialTransform(transform, inPlace=True)
        if trim:
            flat, mask = settled(t0, t1, pose)
            a, b = (smooth(h) * 1e3 for h in (t0, flat))
            method.SetMetricAsMeanSquares()
            method.SetInterpolator(sitk.sitkBSpline3)
            method.SetMetricFixedMask(sitk.GetImageFromArray(mask))
        else:
            a, b = (detail(h) * 1e3 for h in (t0, t1))
            method.SetMetricAsCorrelation()
            method.SetInterpolator(sitk.sitkLinear)
        method.Execute(sitk.GetImageFromArray(a), sitk.GetImageFromArray(b))
        origin = np.array(transform.TransformPoint([0.0, 0.0]))
        matrix = np.eye(3)
        matrix[:2, 0] = np.array(transform.TransformPoint([1.0, 0.0])) - origin
        matrix[:2, 1] = np.array(transform.TransformPoint([0.0, 1.0])) - origin
        matrix[:2, 2] = origin
        pose = from_matrix(matrix, centre)
    return pose


METHODS = {
    "gstlib": (gstlib_register, "gstlib"),
    "scikit-image, masked": (masked_correlation, "skimage"),
    "scikit-image, upsampled": (upsampled_correlation, "skimage"),
    "pystackreg": (stackreg, "pystackreg"),
    "OpenCV, ECC": (ecc, "cv2"),
    "SimpleITK": (simpleitk, "SimpleITK"),
}


def main():
    cases = {"type": int, "default": 10, "help": "pairs of scans a condition"}
    size = {"type": int, "default": 512, "help": "points along a side"}
    methods = {"nargs": "*", "default": [""], "help": "parts of names"}
    rows = RESULTS / "registration.csv"
    chosen = options(__doc__, rows, cases=cases, size=size, methods=methods)
    if not chosen.tables:
        tables = []
        for label, (method, module) in METHODS.items():
            if any(part in label for part in chosen.methods):
                try:
                    __import__(module)
                except ImportError as error:
                    print(f"{label}: not available ({error})")
                    continue
                tables += [
                    measure(label, method, name, case, chosen.size)
                    for name in CONDITIONS
                    for case in range(chosen.cases)
                ]
                print(f"{label}: done", flush=True)
        save(chosen.output, summary(pd.DataFrame(tables)), digits=3)
    print(pd.read_csv(chosen.output).to_string(index=False))


def measure(label, method, condition, case, size):
    """One pair of scans, laid by chance; the same for every method."""
    rng = np.random.default_rng([case, *condition.encode()])
    way, share, turn_deg = rng.uniform([0, 0, -TURN], [2 * math.pi, SHIFT, TURN])
    shift = share * size * np.array([math.sin(way), math.cos(way)])
    turn = math.radians(turn_deg)
    t0, t1 = scans(size, shift=shift, turn=turn, seed=case, **CONDITIONS[condition])
    start = time.process_time()
    try:
        pose = method(t0, t1)
        errors = (
            float(np.hypot(*(pose.shift - shift))),
            math.degrees(abs(pose.turn - turn)),
        )
    except Exception as failure:  # whatever a library raises where it does not converge
        print(
            f"{label}, {condition}, case {case}: {str(failure).strip().splitlines()[-1]}"
        )
        errors = math.inf, math.inf
    row = {
        "method": label,
        "condition": condition,
        "cpu_s": time.process_time() - start,
    }
    return row | dict(zip(("error_points", "turn_error_deg"), errors, strict=True))


def summary(table):
    """Median and largest error, how often it is small, and the time, by method and condition."""
    whole = table.assign(condition="of all")
    groups = pd.concat([table, whole]).groupby(["method", "condition"], sort=False)
    errors = groups.error_points
    columns = {
        "cases": errors.size(),
        "error_median_points": errors.median(),
        "error_p95_points": errors.apply(
            lambda e: sorted(e)[math.ceil(0.95 * len(e)) - 1]
        ),
        "error_largest_points": errors.max(),
        "within_a_fifth": errors.apply(lambda e: (e < 0.2).mean()),
        "lost": errors.apply(lambda e: (~(e < LOST)).mean()),
        "turn_error_median_deg": groups.turn_error_deg.median(),
        "cpu_s_median": groups.cpu_s.median(),
    }
    return pd.DataFrame(columns).reset_index()


if __name__ == "__main__":
    main()
