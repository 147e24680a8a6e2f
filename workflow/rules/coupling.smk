# From the square to its patches.
# Takes: the macroscale surface and contact, and how well T1 matches T0. Gives: where each patch lies on the
# square, the pressure of every patch with its interval, and which patches enter the study.


rule check_placement:
    input:
        face=rules.grid_macroscale.output.face,
        t0=surfaces("T0"),
    output:
        table=table("placement", "3 Coupling"),
    log:
        f"{RESULTS}/logs/check_placement.log",
    priority: 90  # a fault shows before the long steps
    resources:
        mem_mb=growing(500, scan=60),
    params:
        **SETTINGS["check_placement"],
        patches=PLACES,
        code=code("check_placement.py"),
    message:
        "Checking the patch positions against the mesh"
    script:
        "../scripts/check_placement.py"


rule couple_scales:
    input:
        contact=rules.solve_macroscale.output.contact,
        square=SQUARE_CONTACT,
        use=inferred_use,
    output:
        pressures=f"{RESULTS}/coupling/pressures.csv",
    log:
        f"{RESULTS}/logs/couple_scales.log",
    params:
        **SETTINGS["couple_scales"],
        patches=PLACES,
        code=code("couple_scales.py"),
    message:
        "Summing macroscale forces over the patches"
    script:
        "../scripts/couple_scales.py"


rule bound_pressures:
    input:
        face=rules.grid_macroscale.output.face,
        composite=COMPOSITE,
        second=SECOND,
        use=inferred_use,
        pressures=rules.couple_scales.output.pressures,
    output:
        table=table("patch_intervals", "3 Coupling"),
    log:
        f"{RESULTS}/logs/bound_pressures.log",
    resources:
        mem_mb=growing(500, scan=60),
    params:
        load=LOAD,
        material=config["material"],
        patch_mm=PATCH_MM,
        radius_mm=study_radius(config),
        uncertainty=config["uncertainty"],
        seed=config["seed"],
        code=code("bound_pressures.py"),
    message:
        "Computing the intervals of the patch pressures by repeated contacts"
    script:
        "../scripts/bound_pressures.py"


rule select_patches:
    input:
        contact=rules.solve_macroscale.output.contact,
        pressures=rules.couple_scales.output.pressures,
        # of a later stage, which needs nothing of this one
        registration=lambda _: REGISTRATION,
    output:
        table=table("patch_pressures", "3 Coupling"),
    log:
        f"{RESULTS}/logs/select_patches.log",
    params:
        **SETTINGS["couple_scales"],
        selection=config["selection"],
        code=code("select_patches.py"),
    message:
        "Selecting the patches of the study"
    script:
        "../scripts/select_patches.py"


PRESSURES = rules.select_patches.output.table
