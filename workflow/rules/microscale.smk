# Each patch against a flat, or against a counterface where the config names one.
# Takes: the scans and the patches' pressures. Gives: clean surfaces, T1 registered to T0, the error of a
# height change where patches were scanned twice, the contact of every patch up to its own pressure, and the cases that the config asks for: another contact modulus, stick and
# slip under a tangential load (`grinding`), a ceiling on the pressure (`hardness`).
# Several patches share a job: a job takes longer to start than to clean a scan or to solve a contact.

PREPARATIONS = {
    f"{epoch}_scans{part}": (epoch, patches)
    for epoch, ids in [("T0", ALL_PATCHES), ("T1", WORN_PATCHES), ("repeat", REPEATED_PATCHES)]
    for part, patches in batches(ids).items()
}

for job, (epoch, patches) in PREPARATIONS.items():

    rule:
        name:
            f"prepare_{job}"
        input:
            scans=scans_at(epoch.lower(), patches),
        output:
            surfaces=surfaces(epoch, patches),
        log:
            f"{RESULTS}/logs/prepare_{job}.log",
        params:
            epoch=epoch,
            crops=crops_of(patches),
            flips=list(PATCHES.loc[patches, "flip"]),
            settings=config["scans"],
            preprocessing=config["preprocessing"],
            code=code("prepare_scans.py"),
        message:
            f"Cleaning the scans at {epoch}: {listed(patches)}"
        script:
            "../scripts/prepare_scans.py"


if COUNTERFACE_SCAN:

    rule prepare_counterface:
        input:
            scans=[COUNTERFACE_SCAN],
        output:
            surfaces=[COUNTERFACE],
        log:
            f"{RESULTS}/logs/prepare_counterface.log",
        params:
            epoch="T0",
            crops=[None],
            flips=[""],
            settings=config["scans"],
            preprocessing=config["preprocessing"],
            code=code("prepare_scans.py"),
        message:
            "Cleaning the scan of the counterface"
        script:
            "../scripts/prepare_scans.py"


rule tabulate_preprocessing:
    input:
        t0=surfaces("T0", ALL_PATCHES),
        t1=surfaces("T1", WORN_PATCHES),
        repeats=surfaces("repeat", REPEATED_PATCHES),
    output:
        table=table("preprocessing", "1 Inputs"),
    log:
        f"{RESULTS}/logs/tabulate_preprocessing.log",
    params:
        patches=ALL_PATCHES,
        worn=WORN_PATCHES,
        repeated=REPEATED_PATCHES,
        code=code("tabulate_preprocessing.py"),
    message:
        "Tabulating what was done to each scan"
    script:
        "../scripts/tabulate_preprocessing.py"


if REPEATED_PATCHES:

    rule measure_detection:
        input:
            t0=surfaces("T0", REPEATED_PATCHES),
            repeats=surfaces("repeat", REPEATED_PATCHES),
        output:
            detection=DETECTION,
        log:
            f"{RESULTS}/logs/measure_detection.log",
        params:
            patches=REPEATED_PATCHES,
            maximum_shift_mm=config["registration"]["maximum_shift_mm"],
            minimum_points=config["traces"]["minimum_points"],
            code=code("measure_detection.py"),
        message:
            f"Measuring the error of a height change on repeated scans: {listed(REPEATED_PATCHES)}"
        script:
            "../scripts/measure_detection.py"


for part, patches in batches(WORN_PATCHES).items():

    rule:
        name:
            f"register_patches{part}"
        input:
            t0=surfaces("T0", patches),
            t1=surfaces("T1", patches),
            detection=DETECTION,
        output:
            registered=registered(patches),
        log:
            f"{RESULTS}/logs/register_patches{part}.log",
        params:
            patches=patches,
            maximum_shift_mm=config["registration"]["maximum_shift_mm"],
            minimum_points=config["traces"]["minimum_points"],
            code=code("register_patches.py"),
        message:
            f"Registering T1 to T0: {listed(patches)}"
        script:
            "../scripts/register_patches.py"


for part, patches in batches(ALL_PATCHES).items():

    rule:
        name:
            f"solve_patches{part}"
        input:
            t0=surfaces("T0", patches),
            counterface=COUNTERFACE,
            pressures=f"{RESULTS}/coupling/pressures.csv",
            composite=COMPOSITE,
            contact=f"{RESULTS}/macroscale/contact.h5" if COMPOSITE else [],
        output:
            contacts=contacts(patches),
            others=other_contacts(patches),
        log:
            f"{RESULTS}/logs/solve_patches{part}.log",
        params:
            **config["microscale"],
            patches=patches,
            variants=VARIANTS,
            contact_modulus_MPa=CONTACT_MODULUS_MPA,
            code=code("solve_patches.py"),
        message:
            f"Pressing the patches up to their own pressures: {listed(patches)}"
        script:
            "../scripts/solve_patches.py"


rule tabulate_microscale:
    input:
        contacts=contacts(ALL_PATCHES),
        pressures=f"{RESULTS}/tables/patch_pressures.csv",
    output:
        summary=table("microscale_summary", "4 Microscale"),
        paths=f"{RESULTS}/tables/microscale_paths.csv",
    log:
        f"{RESULTS}/logs/tabulate_microscale.log",
    params:
        patches=ALL_PATCHES,
        code=code("tabulate_microscale.py"),
    message:
        "Tabulating the microscale contacts"
    script:
        "../scripts/tabulate_microscale.py"


if CASES:

    rule solve_cases:
        input:
            contacts=contacts(ALL_PATCHES),
            pressures=f"{RESULTS}/tables/patch_pressures.csv",
        output:
            table=table("cases", "4 Microscale"),
        log:
            f"{RESULTS}/logs/solve_cases.log",
        params:
            **CASES,
            patches=ALL_PATCHES,
            code=code("solve_cases.py"),
        message:
            "Solving the cases that the config asks for"
        script:
            "../scripts/solve_cases.py"
