"""The tables of results: what each is called, what it says, and what its columns mean.

This is the only place that lists them. The functions that make a table take the names of its
columns from here, and `gstlib.io.tables.write_table` the digits. The captions of the page and of
the report, the list in README.md and the tests are made from it, too (`make docs`).

To add a column, add its name and its meaning to the table here, and its values where the table is
made. A name ends with the unit, if there is one. Captions are reStructuredText, and Jinja where
they quote the config of a study: whoever shows them fills that in.
"""

from dataclasses import dataclass

__all__ = ["SIGNIFICANT_DIGITS", "TABLES", "Column", "Table", "columns_of"]

# Results are solved to a relative residual of 1e-6 or better; five digits stay above that noise.
SIGNIFICANT_DIGITS = 5
# A stiffness is converged to about 1e-6.
_FEWER_DIGITS = {"stiffness_MPa_per_um": 4, "interface_stiffness_MPa_per_um": 4}
# Units as names of columns end with them; those that end like another one come first.
_UNITS = {
    "MPa_per_um": "MPa/µm",
    "um3_per_um2": "µm³/µm²",
    "N_per_mm": "N/mm",
    "MPa": "MPa",
    "N": "N",
    "mm": "mm",
    "um": "µm",
    "um3": "µm³",
    "deg": "°",
    "mrad": "mrad",
    "percent": "%",
}


@dataclass(frozen=True)
class Column:
    """A column of a table."""

    name: str
    meaning: str

    @property
    def unit(self) -> str:
        """The unit that the name ends with, as it is printed; empty without one."""
        endings = (unit for end, unit in _UNITS.items() if self.name.endswith(f"_{end}"))
        return next(endings, "")

    @property
    def digits(self) -> int:
        """How many significant digits are printed."""
        return _FEWER_DIGITS.get(self.name, SIGNIFICANT_DIGITS)


@dataclass(frozen=True)
class Table:
    """A table of results: a CSV file, by the name that it has in `TABLES`."""

    title: str
    caption: str
    meanings: dict[str, str]  # of the columns, by their names and in their order
    only: str = ""  # when a study has the table, if not always
    optional: tuple[str, ...] = ()  # columns that are not always there
    folder: str = "tables"  # in that of the results

    @property
    def columns(self) -> list[Column]:
        return [Column(*of_column) for of_column in self.meanings.items()]


def columns_of(table: str) -> list[str]:
    """The names of a table's columns, in their order."""
    return list(TABLES[table].meanings)


# --- Columns of several tables ----------------------------------------------------------------

_PATCH = "name of the patch"
_PATCH_OR_SQUARE = "name of the patch; empty for the square"
_EPOCH = "before use (T0), after use (T1), or scanned again without use (repeat)"
_PRESSURE = "pressure of the patch: force on it over its area"
_STUDIED = "number of patches"
_INTERVAL = {"low": "lower end of the 95 % interval", "high": "upper end of the 95 % interval"}
_PRESSED = {
    "patch": _PATCH,
    "x_mm": "centre of the patch in the square, from its lower left corner",
    "y_mm": "the same along y",
    "rotation_deg": "rotation of the patch, from x towards y",
    "force_N": "force on the patch",
    "pressure_MPa": _PRESSURE,
    "peak_pressure_MPa": "highest pressure of a macroscale element in the patch",
    "square_pressure_MPa": (
        "pressure of the patch where the square is pressed alone on its mean plane (levelled)"
    ),
}
_LOADED = {
    "step": "number of the load step",
    "displacement_um": "displacement from first touch",
    "mean_pressure_MPa": "force over nominal area",
    "contact_fraction": "share of the area in contact",
    "stiffness_MPa_per_um": "change of mean pressure with displacement",
}
_INTERFACE = {
    "interface_stiffness_MPa_per_um": (
        "the same without the compliance of the half-space under the patch"
    )
}
_RIVALS = {
    "none": "no loss",
    "mean_volume": "a plane that cuts off the others' mean volume",
    "pressure_volume": "a plane that cuts off a volume in proportion to pressure",
    "pressure_share": "a plane that wears a share in proportion to pressure",
    "rigid": "rigid interpenetration at one displacement",
    "own_area": "a plane that wears the patch's own worn share",
}

# --- The tables, in the order of the study ----------------------------------------------------

TABLES = {
    "inputs": Table(
        "what every scan holds",
        """
        What each scan holds as read, before any cleaning. Where a piece is cut from a larger
        scan, the values describe that piece.
        """,
        {
            "patch": _PATCH,
            "epoch": _EPOCH,
            "file": "name of the file",
            "points_x": "number of points along x",
            "points_y": "number of points along y",
            "spacing_x_um": "distance of the points along x",
            "spacing_y_um": "distance of the points along y",
            "unmeasured": "share of unmeasured points; preprocessing.csv has their number",
            "Sq_um": "r.m.s. height about the best-fit plane",
            "tilt_x_mrad": "slope of that plane along x",
            "tilt_y_mrad": "slope of that plane along y",
            "instrument": "instrument, as the file states it",
            "objective": "objective, as the file states it",
        },
    ),
    "preprocessing": Table(
        "how each scan was cleaned",
        "How each scan was cleaned, filled and levelled.",
        {
            "patch": _PATCH,
            "epoch": _EPOCH,
            "unmeasured": "number of unmeasured points; inputs.csv has their share",
            "filled": "number of points filled",
            "outliers": "number of points replaced as outliers",
            "outlier_k": "threshold: found by the paper's rule, given by the robust one",
            "tilt_x_mrad": "slope removed along x",
            "tilt_y_mrad": "slope removed along y",
            "Sq_before_um": "r.m.s. height of the measured points about their mean",
            "Sq_after_um": "r.m.s. height of the cleaned scan",
        },
    ),
    "gridding": Table(
        "how well each interpolation of the mesh predicts vertices left out",
        """
        The mesh is interpolated on the grid of the square in one of three ways. Each predicts the
        vertices in the square from the others, in eight groups. The grid is made from all
        vertices, so its own error is smaller. ``macroscale.interpolation`` in the config says
        which way is taken; ``best`` takes the one with the smallest error.
        """,
        {
            "interpolation": "way of interpolation",
            "left_out_rms_um": "r.m.s. error at the vertices left out",
            "chosen": "whether the grid is made this way",
        },
    ),
    "macroscale_path": Table(
        "load path of the stone",
        """
        The load path of the stone at rest: a row for each step. On the way it keeps the tilt that
        it has in the end. The nominal area is that of the face that is pressed, or of the square
        where that is pressed alone.
        """,
        {"step": _LOADED["step"], "force_N": "force on the stone", **_LOADED},
    ),
    "placement": Table(
        "whether the scans fit the mesh where the patch table puts them",
        """
        Do the patches lie where the patch table says? The heights of each scan are correlated
        with those of the macroscale surface under it, both without their planes. *agrees*: they
        correlate. *elsewhere*: they do not; half of the patches that lie in a wrong place
        correlate by chance, and are not noticed. *cannot tell*: there are fewer than four
        patches (a clear flip of two or three is warned of), or all correlate by less than 0.5. The
        last row has the shift that all patches share (true less stated position, along the
        square's axes): *shifted* if it differs from 0 at a level of 1 %; the correlations are then
        those after the shift.
        Correct such a shift in the patch table.
        """,
        {
            "patch": "name of the patch; all patches in the last row",
            "correlation": "correlation of scan and square",
            "shift_x_um": "shift that all patches share, along x",
            "shift_y_um": "shift that all patches share, along y",
            "shift_x_error_um": "its standard error along x",
            "shift_y_error_um": "its standard error along y",
            "verdict": "agrees, elsewhere, shifted or cannot tell",
            "looks": (
                "orientation that fits clearly best, if one does; if it is not as given, a warning "
                "names the key to change"
            ),
        },
    ),
    "pressures": Table(
        "pressure of every patch, before the patches are selected",
        "As ``patch_pressures.csv``, for the stages between.",
        _PRESSED,
        folder="coupling",
    ),
    "patch_pressures": Table(
        "pressure of every patch (the paper's Table 1), and whether it is in the study",
        "The pressure of every scanned patch: the force on it over its nominal area.",
        {
            **_PRESSED,
            "in_study": "whether the patch is in the microscale study",
            "reason": "if not, why",
        },
    ),
    "patch_intervals": Table(
        "95 % interval of every patch's pressure",
        """
        The square was pressed 100 times: with the mesh in error as its left-out vertices show,
        with a standard deviation of {{ config.uncertainty.placement_um }} µm in each patch's
        position along each axis, of {{ "%.0f" | format(100 * config.uncertainty.young_share) }} %
        in each stone's Young's modulus and of {{ config.uncertainty.poisson }} in each Poisson's
        ratio{% if config.coupling == "placed" %}, and with other detail between the scans{% endif
        %}. Where the scans are not laid on the mesh (``coupling: levelled``), the last three
        columns are missing.
        """,
        {
            "patch": _PATCH,
            "pressure_MPa": _PRESSURE,
            "low_MPa": "lower end of the 95 % interval",
            "high_MPa": "upper end of the 95 % interval",
            "tilt_mrad": "tilt of the mesh's plane under the patch",
            "tilt_error_mrad": "its standard error along each axis",
            "plane": (
                "mesh: the patch keeps that plane; levelled: the mesh does not know it well enough"
            ),
        },
        optional=("tilt_mrad", "tilt_error_mrad", "plane"),
    ),
    "exposure": Table(
        "what a gesture leaves on each patch",
        "Each patch over the poses of the gesture, beside the single pose.",
        {
            "patch": _PATCH,
            "pressure_MPa": "pressure of the patch in the single pose",
            "mean_pressure_MPa": "mean over the poses",
            "lowest_pressure_MPa": "lowest of the poses",
            "highest_pressure_MPa": "highest of the poses",
            "touched": "share of the poses that touch the patch",
            "exposure_N_per_mm": (
                "pressure times sliding, summed over the poses: what wears by Archard's law"
            ),
        },
        only="with `gesture`",
    ),
    "places": Table(
        "where to scan: the places with the most exposure, and some that nothing touches",
        """
        Places of a patch's size in the square, {{ config.scans.size_mm }} mm wide, that do not
        overlap. *exposed*: each has the most exposure of what the earlier ones left. *control*: no
        pose touches it; each lies as far as possible from what is touched, and from the earlier
        ones. It is a patch table: name the scans of a place after it (E1_T0.plux before use,
        E1_T1.plux after it), and give this file as ``patches``.
        """,
        {
            "place": "name of the place",
            "kind": "exposed or control",
            "x_mm": "centre of the place in the square, from the reference corner along x",
            "y_mm": "the same along y",
            "exposure_N_per_mm": (
                "mean over the place of pressure times sliding, summed over the poses"
            ),
            "touched": "share of the poses that touch the most often touched element of the place",
        },
        only="with `patches: null`",
    ),
    "two_scales": Table(
        "what two scales cost: each patch beside one contact of the whole square",
        """
        Each patch, pressed by itself, beside one contact of the whole square at the scans'
        resolution, the reference. The scores compare the two contacts point by point.
        """,
        {
            "patch": "name of the patch; all: the points of all patches together",
            "variant": (
                "variant of the coupling; highest_VARIANT is a rival without mechanics: as many of "
                "the surface's highest points as touch in the reference"
            ),
            "pressure_MPa": _PRESSURE,
            "reference_pressure_MPa": "pressure of the patch in the reference",
            "contact_fraction": "share of the area in contact",
            "reference_contact_fraction": "the same in the reference",
            "precision": "share of the contact that also touches in the reference",
            "recall": "share of the reference's contact that is found",
            "f1": "harmonic mean of precision and recall",
        },
        only="with `coupling: placed`",
    ),
    "published": Table(
        "published values beside the computed ones",
        "Published values beside those computed here.",
        {
            "quantity": "what is compared",
            "patch": _PATCH_OR_SQUARE,
            "unit": "unit of both values",
            "published": "value of the publication",
            "computed": "value of this study",
        },
        only="with `published`",
    ),
    "microscale_summary": Table(
        "each patch at its own pressure: displacement, contact area, stiffness",
        "Each patch at the pressure that it carries in the square.",
        {
            "patch": _PATCH,
            "target_pressure_MPa": "pressure that the patch carries in the square",
            "mean_pressure_MPa": "pressure that the solution reached",
            "displacement_um": "displacement from first touch",
            "contact_fraction": "share of the area in contact",
            "stiffness_MPa_per_um": "change of mean pressure with displacement",
            **_INTERFACE,
            "residual": (
                "largest violation of the contact conditions over the largest rigid "
                "interpenetration, rounded up to a power of ten"
            ),
        },
    ),
    "microscale_paths": Table(
        "load path of every patch",
        "The load path of each patch: a row for each step.",
        {"patch": _PATCH, **_LOADED, **_INTERFACE},
    ),
    "cases": Table(
        "further cases: a grinding force, a ceiling on the pressure",
        """
        What would change, had the study been asked otherwise? ``study`` is the study's own value
        where a case has another.{% if config.grinding %} ``grinding``: each patch of the study
        under a tangential load of {{ config.grinding.tangential_ratio }} times the force that
        would make it slide, with Coulomb friction {{ config.grinding.friction }} (Ciavarella
        1998; Jäger 1998). Slip begins at the edges of each contact spot; the cores of the summits
        stick. ``slip share`` is the share of the contact that slips; the rest sticks. ``mean
        traction`` is the tangential force over the patch's nominal area, ``tangential
        displacement`` how far the two solids move against each other, far from the
        contact.{% endif %}{% if config.hardness %} ``ceiling``: each patch of the study at the
        same mean pressure, but no element bears more than {{ config.hardness }} MPa. In a purely
        elastic solution the asperities bear far more than the strength of any stone; this case
        shows how much of the predicted contact depends on that. ``share at the ceiling`` is of
        the contact, ``deepest yield`` how far the surface gives way at the ceiling.{% endif %}
        """,
        {
            "case": "study, grinding or ceiling",
            "patch": "name of the patch; empty for all",
            "quantity": "what the value is of",
            "unit": "unit of the value",
            "value": "value in this case",
        },
        only="with `grinding` or `hardness`",
    ),
    "registration": Table(
        "how well T1 is aligned with T0, and what was lost",
        """
        How well the scan after use (T1) is aligned with that before (T0) on each patch, and what
        the two show of the wear. A patch is excluded from the study where T1 covers too little of
        T0 or correlates too little with it. Without an alignment, or with fewer than 100 points
        measured at both epochs, the columns of change are empty.
        """,
        {
            "patch": _PATCH,
            "found": "whether an alignment was found",
            "shift_x_um": "shift of T1 along x",
            "shift_y_um": "shift of T1 along y",
            "rotation_deg": "rotation of T1, from x towards y",
            "overlap": "share of T0 that T1 covers",
            "correlation": "correlation of the heights",
            "detail_correlation": "correlation of their detail, without long waves",
            "height_scale": "depth of the dales at T1 over that at T0",
            "residual_um": "robust standard deviation of the difference over all points",
            "change_sigma_um": "the same over the unchanged points",
            "lateral_sigma_um": "lateral error, estimated from the slopes",
            "level_of_detection_um": "smallest change that is detected, median over the points",
            "detection": (
                "where that and the lateral error come from: repeated scans (repeat), or the "
                "patch's own unchanged part (own)"
            ),
            "known_share": "share of T0 where both heights are known",
            "loss_fraction": "share of the known area that lost height",
            "gain_fraction": "share of the known area that gained height",
            "loss_volume_um3": "volume lost",
            "loss_depth_um": "mean depth where height was lost",
            "loss_per_area_um": (
                "volume lost over the known area, comparable between patches of different overlap"
            ),
            "noise_share": (
                "area that rose over area that fell: noise raises as often as it lowers, so this "
                "is the share of the loss that it would explain"
            ),
            "believed": "whether the loss exceeds noise, and counts in statistics over patches",
            "excluded": "whether this excludes the patch from the study",
            "reason": "if so, why",
        },
        only="with scans after use",
    ),
    "texture": Table(
        "surface texture of each patch, before and after use (ISO 25178-2)",
        """
        Both epochs are measured on the rectangle that both scans cover. A patch without a usable
        T1 has T0 only, on the whole scan. The plane is removed, then waves shorter than {{
        config.texture.s_filter_um }} µm (S-filter){% if config.texture.l_filter_um %} and longer
        than {{ config.texture.l_filter_um }} µm (L-filter){% endif %}, by Gaussian filters (ISO
        16610-61); beyond its edges the map is continued point-symmetrically. Sz, Ssk, Sku, Sdq
        and Sdr follow single points, such as an outlier in one scan: a change in them alone is no
        sign of use.
        """,
        {
            "patch": _PATCH,
            "epoch": "T0, T1, or change: T1 less T0",
            "size_x_mm": "width of the rectangle",
            "size_y_mm": "height of the rectangle",
            "Sa_um": "mean roughness",
            "Sq_um": "r.m.s. roughness",
            "Sz_um": "highest to lowest point",
            "Ssk": "skewness; below 0: more dales than summits",
            "Sku": "kurtosis; 3: normal",
            "Sdq": "r.m.s. slope",
            "Sdr_percent": "area in excess of the flat one",
            "Sal_um": "autocorrelation length: the grain of the texture",
            "Str": "1: isotropic; near 0: striated",
            "Sk_um": "height of the core",
            "Spk_um": "height of the summits above the core",
            "Svk_um": "depth of the dales below the core",
            "Smr1_percent": "share of the area in summits",
            "Smr2_percent": "share of the area in all but the dales",
            "Vmp_um3_per_um2": "material volume of the summits",
            "Vmc_um3_per_um2": "material volume of the core",
            "Vvc_um3_per_um2": "void volume of the core",
            "Vvv_um3_per_um2": "void volume of the dales",
        },
    ),
    "validation_patches": Table(
        "how well the predicted loss of each patch agrees with the measured one",
        """
        Each patch with a scan after use, in the study or not: the loss that the other patches
        foretell, against the measured one. ``mcc`` compares masks: where each exceeds the level
        of detection. The prefixed columns are those of the rivals, which know as much as the
        prediction, and of the ceiling ``own_area``, which knows the patch's own worn share; see
        ``wear.csv``. Chance: what is predicted of other patches, and of any patch turned and
        mirrored, is held against the loss of this one. *noise*: the loss is not believed
        (``registration.csv``), and noise mimics agreement, since a point that it raises at T0 is
        predicted to wear and looks worn at T1. *undefined*: nothing was lost, or no loss is
        predicted.
        """,
        {
            "patch": _PATCH,
            "counted": "whether the patch is in the study and its loss believed",
            "contact_fraction": "share of the patch in predicted contact before use",
            "predicted_loss_um": "predicted volume over the known area, as two scans can see it",
            "mcc": "Matthews' correlation coefficient: 0 at chance, 1 if all agrees",
            "attainable_mcc": "the largest that a mask of the predicted area can reach",
            "map_error": "r.m.s. of predicted less measured loss, over that of no loss",
            **{f"{name}_mcc": f"mcc of {words}" for name, words in _RIVALS.items()},
            "p_value": "one-sided test of mcc against the predictions of other patches",
            "untested": "why there is no p-value: noise or undefined",
        },
        only="with scans after use",
    ),
    "validation_summary": Table(
        "the verdict: the prediction beside its rivals, over all patches",
        """
        Over the patches in the study, except those whose loss may be noise and, row by row, those
        where its numbers are not defined. ``mean(mcc)``: mean agreement of predicted with
        measured loss, of the prediction and of its rivals (``wear.csv``);
        ``mean(attainable_mcc)``: the largest that masks of its areas can reach; ``gain(mcc)``:
        less that of the best rival. ``relative(map_error)``: summed error of the maps over that
        of no loss; ``relative(volume_error)``: summed error of the volumes over that of the best
        rival; below 1, the prediction errs less. Two-sided tests exchange the two on random
        patches; where the best rival is better, its p-value is multiplied by the number of
        rivals. ``tested_mean(mcc)``: over the patches on which chance can be tested, against
        the predictions of other patches, one-sided. ``spearman(...)``: rank correlation,
        two-sided, exact up to 8 patches, allowing for spatial autocorrelation (Dutilleul 1993).
        Of the pressure with the area of the loss; of whether a patch is touched with its volume
        (per area seen): do patches that nothing touches wear less? Patches out of the study
        count there, too.
        {% if config.validation.expected_worst %}``expected_worst(...)``: share of the patches
        stated beforehand as the worst worn that are among as many worst worn ones; the p-value is
        the exact probability that a random ranking does as well.{% endif %}
        {% if config.mat %}``mat_ratio``: coefficient of the mat over that of the bare stone,
        which fits all patches best. ``relative(out_of_contact)`` tests whether a mat was there:
        its error where the bare stone takes off less than is detected, over 98 % of the bare
        stone's.{% endif %}
        Intervals are those of a bootstrap over patches.
        """,
        {
            "model": "prediction or rival; empty where none is judged",
            "statistic": "name of the statistic",
            "value": "its value",
            **_INTERVAL,
            "p_value": "p-value of the test",
            "n": _STUDIED,
            "against": "what the value is compared with",
        },
        only="with scans after use",
    ),
    "wear": Table(
        "loss of each patch, measured and predicted",
        """
        Loss of each patch by model, from the losses of the *other* patches: ``archard``{% if
        config.mat %}, ``mat`` (a soft layer takes turns with the bare stone){% endif %}{% if
        config.hardness %}, ``yielding`` (the same, but no element bears more than {{
        config.hardness }} MPa){% endif %}. Rivals that know as much: ``none`` (no loss),
        ``mean_volume`` (a plane cuts off the others' mean volume), ``pressure_volume`` (it cuts
        off a volume in proportion to the patch's pressure), ``pressure_share`` (it wears a share
        of the patch in proportion to its pressure), ``rigid`` (what a rigid flat cuts off at the
        displacement that fits the others). ``own_area``, a ceiling: a plane that wears the
        patch's own worn share. Only points whose change is known count.
        """,
        {
            "patch": _PATCH,
            "model": "model that predicts the loss",
            "marked_fraction": "share of the known area predicted to lose more than is detected",
            "mcc": "agreement of that area with the one that did",
            "attainable_mcc": "the largest that a mask of that size can reach",
            "predicted_volume_um3": "predicted volume, as far as two scans can see it",
            "measured_volume_um3": "measured volume",
            "map_error_um": "r.m.s. of predicted less measured loss, point by point",
            "out_of_contact_um": "the same where archard takes off less than is detected",
        },
        only="with scans after use",
        optional=("out_of_contact_um",),
    ),
    "wear_profile": Table(
        "loss by height, measured and predicted",
        """
        Each patch's points in four bands of as many points each. A flat takes nothing off
        valleys; what they lost was taken by something soft, or broke out.
        """,
        {
            "patch": _PATCH,
            "band": "1 to 4: from the highest points to the lowest",
            "model": "measured, or the model that predicts the loss",
            "loss_um": "mean loss of the band",
        },
        only="with scans after use",
    ),
    "truth": Table(
        "every stage compared with the truth",
        "What each stage recovered of the generated specimen, beside what is true.",
        {
            "stage": "stage of the study",
            "quantity": "what is compared",
            "patch": _PATCH_OR_SQUARE,
            "unit": "unit of the values",
            "true": "true value",
            "recovered": "value that the stage recovered",
            "error": "recovered less true value",
        },
        only="generated specimen only",
    ),
}
