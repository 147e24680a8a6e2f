# Was the prediction right?
# Takes: predicted contact, and T1 registered to T0. Gives: scores per patch and over the patches,
# each compared with chance and with rivals that need no mechanics; how much each patch wears by
# Archard's law; the texture of each patch before and after use.

EXPECTED_WORST = config["validation"]["expected_worst"]


if WORN_PATCHES:

    rule score_patches:
        input:
            contacts=contacts(WORN_PATCHES),
            others=other_contacts(WORN_PATCHES),
            registered=registered(WORN_PATCHES),
            pressures=f"{RESULTS}/tables/patch_pressures.csv",
            microscale=f"{RESULTS}/tables/microscale_summary.csv",
            exposure=f"{RESULTS}/tables/exposure.csv" if POSES is not None else [],
        output:
            patches=table("validation_patches", "5 Validation"),
            gains=table("validation_gains", "5 Validation"),
            summary=table("validation_summary", "5 Validation"),
            variants=table("validation_variants", "5 Validation"),
        log:
            f"{RESULTS}/logs/score_patches.log",
        params:
            worn=WORN_PATCHES,
            compared=VARIANTS,
            validation={
                key: value
                for key, value in config["validation"].items()
                if key != "expected_worst"
            },
            # a claim about other patches says nothing about these
            worst=EXPECTED_WORST if set(EXPECTED_WORST) <= set(ALL_PATCHES) else [],
            seed=config["seed"],
            code=code("score_patches.py"),
        message:
            "Scoring predicted contact against measured height loss"
        script:
            "../scripts/score_patches.py"

    if config["wear_steps"] is not None:

        rule predict_wear:
            input:
                contact=f"{RESULTS}/macroscale/contact.h5",
                second=SECOND if POSES is not None else [],
                contacts=contacts(WORN_PATCHES),
                registered=registered(WORN_PATCHES),
                pressures=f"{RESULTS}/tables/patch_pressures.csv",
                scores=f"{RESULTS}/tables/validation_patches.csv",
            output:
                folder=directory(f"{RESULTS}/wear"),
                table=table("wear", "6 Wear"),
                profile=table("wear_profile", "6 Wear"),
                summary=table("wear_summary", "6 Wear"),
            log:
                f"{RESULTS}/logs/predict_wear.log",
            params:
                worn=WORN_PATCHES,
                patch_mm=PATCH_MM,
                steps=config["wear_steps"],
                mat=config["mat"],
                poses=None if POSES is None else POSES.to_dict("list"),
                size_mm=SQUARE_MM,
                seed=config["seed"],
                resamples=config["validation"]["resamples"],
                code=code("predict_wear.py"),
            message:
                "Wearing the square and its patches"
            script:
                "../scripts/predict_wear.py"


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
