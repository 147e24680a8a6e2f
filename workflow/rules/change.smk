# What use has changed.
# Takes: the clean scans. Gives: the error of a height change where patches were scanned twice, T1
# registered to T0 with the height change, and the texture of each patch before and after use.

DETECTION = []


if REPEATED_PATCHES:

    rule estimate_detection_limit:
        input:
            t0=expand(
                rules.prepare_scans.output.surfaces,
                epoch="T0",
                batch=SCANNED_BATCHES["repeat"],
            ),
            repeats=surfaces("repeat"),
        output:
            detection=f"{RESULTS}/change/detection.h5",
        log:
            f"{RESULTS}/logs/estimate_detection_limit.log",
        resources:
            mem_mb=growing(500, scan=100),
            runtime=growing(10, scans=0.5),
        params:
            **SETTINGS["register_patches"],
            patches=REPEATED_PATCHES,
            code=code("estimate_detection_limit.py"),
        message:
            "Measuring the error of a height change on repeated scans"
        script:
            "../scripts/estimate_detection_limit.py"

    DETECTION = rules.estimate_detection_limit.output.detection


rule register_patches:
    input:
        t0=surfaces_of_batch("T0"),
        t1=surfaces_of_batch("T1"),
        detection=DETECTION,
    output:
        registered=directory(f"{RESULTS}/change/{{batch}}"),
    log:
        f"{RESULTS}/logs/register_patches_{{batch}}.log",
    resources:
        mem_mb=growing(500, scan=100),
        runtime=growing(10, batch=0.5),
    params:
        **SETTINGS["register_patches"],
        patches=lambda wildcards: WORN_BATCHES[wildcards.batch],
        code=code("register_patches.py"),
    message:
        f"Registering T1 to T0: part {{wildcards.batch}} of {len(BATCHES)}"
    script:
        "../scripts/register_patches.py"


CHANGES = expand(rules.register_patches.output.registered, batch=WORN_BATCHES)


REGISTRATION = []


if WORN_PATCHES:

    rule tabulate_changes:
        input:
            registered=CHANGES,
        output:
            registration=table("registration", "5 Validation"),
        log:
            f"{RESULTS}/logs/tabulate_changes.log",
        resources:
            mem_mb=growing(500, scan=60),
        params:
            **SETTINGS["select_patches"],
            worn=WORN_PATCHES,
            accept=config["accept"],
            code=code("tabulate_changes.py"),
        message:
            "Measuring the match of T1 with T0, and the loss"
        script:
            "../scripts/tabulate_changes.py"

    REGISTRATION = rules.tabulate_changes.output.registration


# All patches in one job: loading the library of texture parameters takes as long as five patches.
rule tabulate_texture:
    input:
        t0=surfaces("T0"),
        registered=CHANGES,
    output:
        table=table("texture", "5 Validation" if WORN_PATCHES else "1 Inputs"),
    log:
        f"{RESULTS}/logs/tabulate_texture.log",
    resources:
        mem_mb=growing(500, scan=120),
        runtime=growing(10, scans=0.5),
    params:
        patches=ALL_PATCHES,
        worn=WORN_PATCHES,
        texture=config["texture"],
        code=code("tabulate_texture.py"),
    message:
        "Measuring the texture of the patches"
    script:
        "../scripts/tabulate_texture.py"
