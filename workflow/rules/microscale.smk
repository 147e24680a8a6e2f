# Each patch against a flat, or against a counterface where the config names one.
# Takes: the clean scans and the patches' pressures. Gives: the contact of every patch up to its own
# pressure, and the cases that the config asks for: stick and slip under a tangential load (`grinding`), a
# cap on the pressure (`pressure_cap_MPa`).


rule solve_patches:
    input:
        t0=surfaces_of_batch("T0"),
        counterface=rules.prepare_counterface.output.surface if COUNTERFACE_SCAN else [],
        pressures=rules.couple_scales.output.pressures,
        composite=COMPOSITE,
        contact=rules.solve_macroscale.output.contact if COMPOSITE else [],
    output:
        **(
            {"others": directory(f"{RESULTS}/microscale/{VARIANTS[1]}/{{batch}}")}
            if VARIANTS[1:]
            else {}
        ),
        contacts=directory(f"{RESULTS}/microscale/{{batch}}"),
    log:
        f"{RESULTS}/logs/solve_patches_{{batch}}.log",
    resources:
        mem_mb=growing(600, scan=80),
        runtime=growing(10, batch=0.5),
    params:
        microscale=SETTINGS["solve_patches"],
        patches=lambda wildcards: BATCHES[wildcards.batch],
        variants=VARIANTS,
        code=code("solve_patches.py"),
    message:
        f"Pressing the patches up to their own pressures: part {{wildcards.batch}} of {len(BATCHES)}"
    script:
        "../scripts/solve_patches.py"


CONTACTS = expand(rules.solve_patches.output.contacts, batch=BATCHES)
# Those of the variant that the study's own is compared with, if there is one.
OTHER_CONTACTS = expand(rules.solve_patches.output.others, batch=BATCHES) if VARIANTS[1:] else []


rule tabulate_microscale:
    input:
        contacts=CONTACTS,
        pressures=PRESSURES,
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


# The cases that are solved beside the study; none of them, no table.
if config["grinding"] or config["pressure_cap_MPa"]:

    rule solve_cases:
        input:
            contacts=CONTACTS,
            pressures=PRESSURES,
        output:
            table=table("cases", "4 Microscale"),
        log:
            f"{RESULTS}/logs/solve_cases.log",
        resources:
            mem_mb=growing(500, scan=160),
            runtime=growing(10, scans=0.5),
        params:
            grinding=config["grinding"]
            and {**config["grinding"], "poisson": study_poisson(config["material"])},
            pressure_cap=config["pressure_cap_MPa"],
            patches=ALL_PATCHES,
            code=code("solve_cases.py"),
        message:
            "Solving the cases in the config"
        script:
            "../scripts/solve_cases.py"
