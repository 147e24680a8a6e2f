# From the square to its patches.
# Takes: the macroscale surface and contact, and how well T1 lies over T0. Gives: where each patch
# lies on the square, every patch's pressure, and which patches enter the microscale study. It is a
# checkpoint, since the rest of the DAG depends on that.


# Paths and no `rules.name.output` beside files of every patch: Snakemake would look each of them up
# among all of them.
rule place_patches:
    input:
        surface=f"{RESULTS}/macroscale/surface.h5",
        surfaces=expand(f"{RESULTS}/surfaces/{{patch}}_T0.h5", patch=PATCHES.index),
    output:
        table=report(
            f"{RESULTS}/tables/placement.csv",
            caption="../report/placement_table.rst",
            category="3 Coupling",
            labels={"what": "table: where the patches lie"},
        ),
        maps=f"{RESULTS}/coupling/placement.h5",
    log:
        f"{RESULTS}/logs/place_patches.log",
    benchmark:
        f"{RESULTS}/benchmarks/place_patches.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        patches=PATCHES.to_dict("list"),
        patch_mm=PATCH_MM,
        maximum_shift_um=config["placement"]["maximum_shift_um"],
        significance=config["placement"]["significance"],
        seed=config["placement"]["seed"],
        code=code("place_patches.py"),
    message:
        "Looking for the patches on the square"
    script:
        "../scripts/place_patches.py"


checkpoint couple_scales:
    input:
        contact=f"{RESULTS}/macroscale/contact.h5",
        registered=expand(f"{RESULTS}/registered/{{patch}}.h5", patch=WORN_PATCHES),
        surfaces=expand(f"{RESULTS}/surfaces/{{patch}}_T0.h5", patch=PATCHES.index),
        placement=f"{RESULTS}/tables/placement.csv" if config["placement"]["correct"] else [],
    output:
        table=report(
            f"{RESULTS}/tables/patch_pressures.csv",
            caption="../report/patch_pressures.rst",
            category="3 Coupling",
            labels={"what": "table: pressure of every patch"},
        ),
    log:
        f"{RESULTS}/logs/couple_scales.log",
    benchmark:
        f"{RESULTS}/benchmarks/couple_scales.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        patches=PATCHES.to_dict("list"),
        worn=WORN_PATCHES,
        patch_mm=PATCH_MM,
        square_mm=SQUARE_MM,
        shift_um=[config["placement"][f"shift_{axis}_um"] for axis in "xy"],
        selection=config["selection"],
        code=code("couple_scales.py"),
    message:
        "Summing macroscale forces over the patches"
    script:
        "../scripts/couple_scales.py"


rule solve_sensitivity:
    input:
        surface=rules.grid_macroscale.output.surface,
        pressures=f"{RESULTS}/tables/patch_pressures.csv",
    output:
        table=report(
            f"{RESULTS}/tables/sensitivity.csv",
            caption="../report/sensitivity.rst",
            category="3 Coupling",
            labels={"what": "table: contact modulus"},
        ),
    log:
        f"{RESULTS}/logs/solve_sensitivity.log",
    benchmark:
        f"{RESULTS}/benchmarks/solve_sensitivity.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        moduli_MPa={
            "used": CONTACT_MODULUS_MPA,
            "from the elastic constants": ALTERNATIVE_MODULUS_MPA,
        },
        patch_mm=PATCH_MM,
        target_pressure_MPa=config["macroscale"]["target_pressure_MPa"],
        tolerance=config["macroscale"]["tolerance"],
        code=code("solve_sensitivity.py"),
    message:
        "Solving the macroscale with the other reading of the contact modulus"
    script:
        "../scripts/solve_sensitivity.py"


rule bound_pressures:
    input:
        surface=rules.grid_macroscale.output.surface,
        contact=rules.solve_macroscale.output.contact,
        pressures=f"{RESULTS}/tables/patch_pressures.csv",
    output:
        table=report(
            f"{RESULTS}/tables/patch_intervals.csv",
            caption="../report/patch_intervals.rst",
            category="3 Coupling",
            labels={"what": "table: interval of every patch's pressure"},
        ),
    log:
        f"{RESULTS}/logs/bound_pressures.log",
    benchmark:
        f"{RESULTS}/benchmarks/bound_pressures.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        material=config["material"],
        contact_modulus_MPa=CONTACT_MODULUS_MPA,
        target_pressure_MPa=config["macroscale"]["target_pressure_MPa"],
        tolerance=config["macroscale"]["tolerance"],
        patch_mm=PATCH_MM,
        uncertainty=config["uncertainty"],
        code=code("bound_pressures.py"),
    message:
        "Drawing places and elastic constants, for the intervals of the patches' pressures"
    script:
        "../scripts/bound_pressures.py"


if config["published"] is not None:

    rule compare_published:
        input:
            published=config["published"],
            path=rules.solve_macroscale.output.path,
            pressures=f"{RESULTS}/tables/patch_pressures.csv",
        output:
            table=report(
                f"{RESULTS}/tables/published.csv",
                caption="../report/published.rst",
                category="3 Coupling",
                labels={"what": "table: published against computed"},
            ),
        log:
            f"{RESULTS}/logs/compare_published.log",
        benchmark:
            f"{RESULTS}/benchmarks/compare_published.tsv"
        threads: 1
        resources:
            mem_mb=memory_mb,
            runtime=minutes,
        params:
            code=code("compare_published.py"),
        message:
            "Setting the published figures beside the computed ones"
        script:
            "../scripts/compare_published.py"
