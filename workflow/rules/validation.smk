# Was the prediction right?
# Takes: the contact of the stone and of its patches, and T1 registered to T0. Gives: the loss of each
# patch that the other patches foretell by Archard's law; how well it agrees with the measured one, beside
# rivals that know as much; the texture of each patch before and after use.

EXPECTED_WORST = config["validation"]["expected_worst"]


if WORN_PATCHES:

    rule predict_wear:
        input:
            contact=f"{RESULTS}/macroscale/contact.h5",
            second=SECOND if POSES is not None else [],
            contacts=contacts(WORN_PATCHES),
            registered=registered(WORN_PATCHES),
            pressures=f"{RESULTS}/tables/patch_pressures.csv",
            registration=f"{RESULTS}/tables/registration.csv",
        output:
            folder=directory(f"{RESULTS}/wear"),
        log:
            f"{RESULTS}/logs/predict_wear.log",
        params:
            worn=WORN_PATCHES,
            patch_mm=PATCH_MM,
            steps=config["wear_steps"],
            mat=config["mat"],
            hardness_MPa=config["hardness"],
            poses=None if POSES is None else POSES.to_dict("list"),
            size_mm=SQUARE_MM,
            code=code("predict_wear.py"),
        message:
            "Wearing the square and its patches"
        script:
            "../scripts/predict_wear.py"

    rule judge_wear:
        input:
            contacts=contacts(WORN_PATCHES),
            registered=registered(WORN_PATCHES),
            folder=f"{RESULTS}/wear",
            pressures=f"{RESULTS}/tables/patch_pressures.csv",
            registration=f"{RESULTS}/tables/registration.csv",
        output:
            patches=table("validation_patches", "5 Validation"),
            table=table("wear", "5 Validation"),
            profile=table("wear_profile", "5 Validation"),
            summary=table("validation_summary", "5 Validation"),
        log:
            f"{RESULTS}/logs/judge_wear.log",
        params:
            worn=WORN_PATCHES,
            # a claim about other patches says nothing about these
            expected_worst=EXPECTED_WORST if set(EXPECTED_WORST) <= set(ALL_PATCHES) else [],
            seed=config["seed"],
            resamples=config["validation"]["resamples"],
            code=code("judge_wear.py"),
        message:
            "Judging the predicted loss by the measured one"
        script:
            "../scripts/judge_wear.py"


# All patches in one job: loading the library of texture parameters takes as long as five patches.
rule tabulate_texture:
    input:
        t0=surfaces("T0", ALL_PATCHES),
        registered=registered(WORN_PATCHES),
    output:
        table=table("texture", "5 Validation" if WORN_PATCHES else "1 Inputs"),
    log:
        f"{RESULTS}/logs/tabulate_texture.log",
    params:
        patches=ALL_PATCHES,
        worn=WORN_PATCHES,
        texture=config["texture"],
        code=code("tabulate_texture.py"),
    message:
        "Measuring the texture of the patches"
    script:
        "../scripts/tabulate_texture.py"
