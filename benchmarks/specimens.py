"""Studies of synthetic specimens in memory, with any kind of wear: for the other scripts."""

import re
from functools import partial

import numpy as np
from runner import ROOT

from gst.config.reading import complete, read_config_file, read_study
from gstlib.errors import InputError
from gstlib.specimen.generate import make_specimen
from gstlib.specimen.law import wear_depth
from gstlib.specimen.randomness import (
    ROLL_OFF_MM,
    SpecimenParameters,
    self_affine_field,
    stream,
)
from gstlib.study import Study

BY_RULE, LAWS = ("summits", "random", "waves"), ("archard", "interlayer")
# Stages that no scan after use enters; of the latter, only while the use is as stated.
_BEFORE_USE = "face", "composite", "square_contact", "counterface"
_OF_STATED_USE = "contact", "pressures"


def merged(config, changes):
    """The config with some of its values replaced; neither of the two is altered."""
    result = dict(config)
    for key, value in changes.items():
        is_section = isinstance(value, dict) and isinstance(config.get(key), dict)
        result[key] = merged(config[key], value) if is_section else value
    return result


def specimen_config(*files):
    """The default config with what `files` change in it."""
    config = {}
    for file in (ROOT / "config/config.yaml", *files):
        config = merged(config, read_config_file(file))
    config = complete(config)
    config["patches"] = str(ROOT / config["patches"])
    return config


def worn_patches(config):
    """The patches of a config that have a T1."""
    patches = read_study(config, "config")
    return patches[patches.t1 != ""].reset_index(drop=True)


def worn_at_random(stone):
    """Wear on summits, with its amount, shapes and clusters, moved elsewhere by chance."""
    # ASSUME: every shift is equally likely, so that on average over shifts the wear has no
    # covariance with any surface.
    generator = stream(stone.parameters.seed, "wear", "placement")
    depth = stone.worn_by_rules()
    return np.roll(depth, generator.integers(0, len(depth), 2), axis=(0, 1))


def worn_in_waves(stone):
    """Wear of one depth, that of summits, on ``wear_fraction`` in waves longer than a patch."""
    # ASSUME: wear that follows something other than heights, such as the hand's grip, varies over
    # lengths like the stone's. It has one depth, so it is detected wherever it lies.
    p = stone.parameters
    depth = stone.worn_by_rules()
    field = self_affine_field(
        stream(p.seed, "wear", "waves"),
        len(depth),
        stone.spacing,
        hurst_exponent=p.hurst_exponent,
        roll_off=ROLL_OFF_MM,
    )
    worn = field > np.quantile(field, 1 - p.wear_fraction)
    return np.where(worn, depth.sum() / max((depth > 0).sum(), 1), 0).astype(np.float32)


# How a stone can lose height: by the specimen's rule, with no relation to heights, and by law.
WEARS = {name: partial(wear_depth, placement=name) for name in ("summits", *LAWS)}
WEARS |= {"random": worn_at_random, "waves": worn_in_waves}


def specimen_studies(config, patches, specimen_seed, wears=BY_RULE):
    """Each of these `WEARS`, one by one, and the study of the specimen with that wear.

    The later studies take from the first every stage that no scan after use enters. `config` is
    complete, and each patch has a T1; `specimen_seed` takes the place of that of ``specimen``.
    """
    parameters = SpecimenParameters(**config["specimen"] | {"seed": specimen_seed})
    square_mm, grid = config["square"]["size_mm"], config["macroscale"]["grid"]
    sizes = {"square_mm": square_mm, "grid": grid}
    first = None
    for wear in wears:
        specimen = make_specimen(patches, parameters, **sizes, wear=WEARS[wear])
        study = study_of(config, patches, specimen)
        if first is not None:
            take(study, first, _BEFORE_USE)
            scans = {
                key: scan for key, scan in first.prepared.items() if key[1] != "T1"
            }
            study.prepared.update(scans)
            if config["use"] is None:
                take(study, first, _OF_STATED_USE)
                study.contacts.update(first.contacts)
        yield wear, study
        first = first or study


def study_of(config, patches, specimen):
    """The study of one specimen, whatever parameters it was made from."""
    settings = {key: value for key, value in config.items() if key != "specimen"}
    return Study(
        settings,
        patches,
        read_mesh=lambda: specimen.mesh,
        read_scan=lambda *patch_and_epoch: specimen.scans[patch_and_epoch],
    )


def take(study, other, stages):
    """Give a study the stages that another one has computed."""
    for stage in stages:
        if stage in vars(other):
            setattr(study, stage, vars(other)[stage])


def changed(study, changes):
    """The same study on the same files, with some values of its config replaced."""
    files = {"read_mesh": study.read_mesh, "read_scan": study.read_scan}
    return Study(merged(study.config, changes), study.patches, **files)


def asked(ask, study):
    """The result of `ask` on a study, without each T1 that the study refuses."""
    while True:
        try:
            return ask(study)
        except InputError as error:
            refused = re.match(r"patch (\w+), T1", str(error.source))
            if refused is None:
                raise
            study.worn.remove(refused[1])
