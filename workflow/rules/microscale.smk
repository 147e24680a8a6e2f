# Each patch against a flat, or against a counterface where the config names one.
# Takes: the scans and the patches' pressures. Gives: clean surfaces, T1 laid over T0, the contact
# of every patch in the study up to its own pressure (one job per patch).


# Many scans in one job: to start the reader of scans takes longer than to clean a scan.
SCAN_BATCHES = {
    f"prepare_{epoch.lower()}_scans{part}": (epoch, patches)
    for epoch, ids in [("T0", list(PATCHES.index)), ("T1", WORN_PATCHES)]
    for part, patches in batches(ids)
}

for job, (epoch, patches) in SCAN_BATCHES.items():

    rule:
        name:
            job
        input:
            scans=scan_files(epoch.lower(), patches),
        output:
            surfaces=[f"{RESULTS}/surfaces/{patch}_{epoch}.h5" for patch in patches],
        log:
            f"{RESULTS}/logs/{job}.log",
        benchmark:
            f"{RESULTS}/benchmarks/{job}.tsv"
        threads: 1
        resources:
            mem_mb=memory_mb,
            runtime=minutes,
        params:
            crops=crops_of(patches),
            patch_mm=PATCH_MM,
            scans=config["scans"],
            preprocessing=config["preprocessing"],
            code=code("prepare_scans.py"),
        message:
            f"Cleaning the scans at {epoch}: {named(patches)}"
        script:
            "../scripts/prepare_scans.py"


for part, patches in batches(WORN_PATCHES):

    rule:
        name:
            f"register_patches{part}"
        input:
            t0=[f"{RESULTS}/surfaces/{patch}_T0.h5" for patch in patches],
            t1=[f"{RESULTS}/surfaces/{patch}_T1.h5" for patch in patches],
        output:
            registered=[f"{RESULTS}/registered/{patch}.h5" for patch in patches],
        log:
            f"{RESULTS}/logs/register_patches{part}.log",
        benchmark:
            f"{RESULTS}/benchmarks/register_patches{part}.tsv"
        threads: 1
        resources:
            mem_mb=memory_mb,
            runtime=minutes,
        params:
            patches=patches,
            maximum_shift_mm=config["registration"]["maximum_shift_mm"],
            minimum_points=config["traces"]["minimum_points"],
            code=code("register_patches.py"),
        message:
            f"Laying T1 over T0: {named(patches)}"
        script:
            "../scripts/register_patches.py"


if WORN_PATCHES:

    rule tabulate_registration:
        input:
            registered=expand(f"{RESULTS}/registered/{{patch}}.h5", patch=WORN_PATCHES),
        output:
            table=report(
                f"{RESULTS}/tables/registration.csv",
                caption="../report/registration.rst",
                category="5 Validation",
                labels={"what": "table: how T1 lies over T0"},
            ),
        log:
            f"{RESULTS}/logs/tabulate_registration.log",
        benchmark:
            f"{RESULTS}/benchmarks/tabulate_registration.tsv"
        threads: 1
        resources:
            mem_mb=memory_mb,
            runtime=minutes,
        params:
            patches=WORN_PATCHES,
            selection=config["selection"],
            code=code("tabulate_registration.py"),
        message:
            "Gathering how T1 lies over T0"
        script:
            "../scripts/tabulate_registration.py"


if COUNTERFACE is not None:

    rule prepare_counterface:
        input:
            scans=[COUNTERFACE],
        output:
            surfaces=[f"{RESULTS}/surfaces/counterface.h5"],
        log:
            f"{RESULTS}/logs/prepare_counterface.log",
        benchmark:
            f"{RESULTS}/benchmarks/prepare_counterface.tsv"
        threads: 1
        resources:
            mem_mb=memory_mb,
            runtime=minutes,
        params:
            crops=[None],
            patch_mm=PATCH_MM,
            scans=config["scans"],
            preprocessing=config["preprocessing"],
            code=code("prepare_scans.py"),
        message:
            "Cleaning the scan of the counterface"
        script:
            "../scripts/prepare_scans.py"


rule tabulate_preprocessing:
    input:
        t0=expand(f"{RESULTS}/surfaces/{{patch}}_T0.h5", patch=PATCHES.index),
        t1=expand(f"{RESULTS}/surfaces/{{patch}}_T1.h5", patch=WORN_PATCHES),
    output:
        table=report(
            f"{RESULTS}/tables/preprocessing.csv",
            caption="../report/preprocessing.rst",
            category="1 Inputs",
            labels={"what": "table: what was done to each scan"},
        ),
        outliers=report(
            f"{RESULTS}/tables/outliers.csv",
            caption="../report/outliers.rst",
            category="1 Inputs",
            labels={"what": "table: outliers of each scan by both rules"},
        ),
    log:
        f"{RESULTS}/logs/tabulate_preprocessing.log",
    benchmark:
        f"{RESULTS}/benchmarks/tabulate_preprocessing.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        patches=list(PATCHES.index),
        worn=WORN_PATCHES,
        code=code("tabulate_preprocessing.py"),
    message:
        "Gathering what was done to each scan"
    script:
        "../scripts/tabulate_preprocessing.py"


rule solve_patch:
    input:
        surface=f"{RESULTS}/surfaces/{{patch}}_T0.h5",
        counterface=[] if COUNTERFACE is None else f"{RESULTS}/surfaces/counterface.h5",
        # ancient: a patch is solved again when its own pressure changes (a parameter), not
        # whenever the table is written
        pressures=ancient(f"{RESULTS}/tables/patch_pressures.csv"),
    output:
        contact=f"{RESULTS}/microscale/{{patch}}.h5",
    log:
        f"{RESULTS}/logs/solve_patch/{{patch}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/solve_patch/{{patch}}.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        target_pressure_MPa=patch_pressure,
        contact_modulus_MPa=CONTACT_MODULUS_MPA,
        steps=config["microscale"]["steps"],
        tolerance=config["microscale"]["tolerance"],
        maximum_displacement_um=config["microscale"]["maximum_displacement_um"],
        code=code("solve_patch.py"),
    message:
        "Pressing patch {wildcards.patch} up to {params.target_pressure_MPa} MPa"
    script:
        "../scripts/solve_patch.py"


rule gather_microscale:
    input:
        contacts=for_studied_patches("{results}/microscale/{patch}.h5"),
    output:
        summary=report(
            f"{RESULTS}/tables/microscale_summary.csv",
            caption="../report/microscale_summary.rst",
            category="4 Microscale",
            labels={"what": "table: state at each patch's pressure"},
        ),
        paths=f"{RESULTS}/tables/microscale_paths.csv",
    log:
        f"{RESULTS}/logs/gather_microscale.log",
    benchmark:
        f"{RESULTS}/benchmarks/gather_microscale.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        patches=lambda wildcards: studied_patches(),
        code=code("gather_microscale.py"),
    message:
        "Gathering the microscale contacts"
    script:
        "../scripts/gather_microscale.py"
