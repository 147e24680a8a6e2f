# Each patch against a flat, one job per patch.
# Takes: the scans and the patches' pressures. Gives: clean surfaces, T1 laid over T0, the contact
# of every patch in the study up to its own pressure.

PREPARATION = dict(
    patch_mm=PATCH_MM,
    scans=config["scans"],
    preprocessing=config["preprocessing"],
    code=code("prepare_patch.py"),
)


rule prepare_patch:
    input:
        t0=scan_file("T0"),
        t1=scan_file("T1"),
    output:
        t0=f"{RESULTS}/surfaces/{{patch}}_T0.h5",
        t1=f"{RESULTS}/surfaces/{{patch}}_T1.h5",
        registered=f"{RESULTS}/registered/{{patch}}.h5",
    log:
        f"{RESULTS}/logs/prepare_patch/{{patch}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/prepare_patch/{{patch}}.tsv"
    wildcard_constraints:
        patch="|".join(WORN_PATCHES) or "(?!)",
    threads: 1
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        **PREPARATION,
        crop=lambda wildcards: crop_of(wildcards.patch),
        maximum_shift_mm=config["registration"]["maximum_shift_mm"],
    message:
        "Cleaning the scans of patch {wildcards.patch} and laying T1 over T0"
    script:
        "../scripts/prepare_patch.py"


# a patch without T1 is a full citizen: it only lacks the registration
use rule prepare_patch as prepare_unworn_patch with:
    input:
        t0=scan_file("T0"),
    output:
        t0=f"{RESULTS}/surfaces/{{patch}}_T0.h5",
    log:
        f"{RESULTS}/logs/prepare_unworn_patch/{{patch}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/prepare_unworn_patch/{{patch}}.tsv"
    wildcard_constraints:
        patch="|".join(PATCHES.index.difference(WORN_PATCHES)) or "(?!)",
    params:
        **PREPARATION,
        crop=lambda wildcards: crop_of(wildcards.patch),
    message:
        "Cleaning the scan of patch {wildcards.patch}"


rule tabulate_preprocessing:
    input:
        t0=expand(f"{RESULTS}/surfaces/{{patch}}_T0.h5", patch=PATCHES.index),
        t1=expand(f"{RESULTS}/surfaces/{{patch}}_T1.h5", patch=WORN_PATCHES),
    output:
        table=report(
            f"{RESULTS}/tables/preprocessing.csv",
            caption="../report/preprocessing.rst",
            category="1 Inputs",
            labels={"what": "what was done to each scan", "kind": "table"},
        ),
    log:
        f"{RESULTS}/logs/tabulate_preprocessing.log",
    benchmark:
        f"{RESULTS}/benchmarks/tabulate_preprocessing.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
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
        mem_mb=1500,
        runtime=60,
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
            labels={"what": "state at each patch's pressure", "kind": "table"},
        ),
        paths=f"{RESULTS}/tables/microscale_paths.csv",
    log:
        f"{RESULTS}/logs/gather_microscale.log",
    benchmark:
        f"{RESULTS}/benchmarks/gather_microscale.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        patches=lambda wildcards: studied_patches(),
        code=code("gather_microscale.py"),
    message:
        "Gathering the microscale contacts"
    script:
        "../scripts/gather_microscale.py"
