# From the square to its patches.
# Takes: the macroscale surface and contact, and how well T1 matches T0. Gives: where each patch lies on the
# square, the pressure of every patch with its interval, and which patches enter the study. Afterwards the
# contact of the patches is held against one contact of the whole square at their resolution.


rule place_patches:
    input:
        face=FACE,
        t0=surfaces("T0", ALL_PATCHES),
    output:
        table=table("placement", "3 Coupling"),
    log:
        f"{RESULTS}/logs/place_patches.log",
    params:
        patches=PLACES,
        patch_mm=PATCH_MM,
        mould=config["scans"]["mould"],
        code=code("place_patches.py"),
    message:
        "Holding the patches against the square"
    script:
        "../scripts/place_patches.py"


rule couple_scales:
    input:
        face=FACE,
        contact=f"{RESULTS}/macroscale/contact.h5",
    output:
        pressures=f"{RESULTS}/coupling/pressures.csv",
    log:
        f"{RESULTS}/logs/couple_scales.log",
    params:
        patches=PLACES,
        patch_mm=PATCH_MM,
        force_N=LOAD["force_N"],
        contact_modulus_MPa=CONTACT_MODULUS_MPA,
        tolerance=config["macroscale"]["tolerance"],
        code=code("couple_scales.py"),
    message:
        "Summing macroscale forces over the patches"
    script:
        "../scripts/couple_scales.py"


rule select_patches:
    input:
        pressures=f"{RESULTS}/coupling/pressures.csv",
        registered=registered(WORN_PATCHES),
    output:
        **({"registration": table("registration", "5 Validation")} if WORN_PATCHES else {}),
        table=table("patch_pressures", "3 Coupling"),
    log:
        f"{RESULTS}/logs/select_patches.log",
    params:
        worn=WORN_PATCHES,
        selection=config["selection"],
        most_noise=config["validation"]["most_noise"],
        code=code("select_patches.py"),
    message:
        "Selecting the patches of the study"
    script:
        "../scripts/select_patches.py"


rule bound_pressures:
    input:
        face=FACE,
        composite=COMPOSITE,
        second=SECOND,
        pressures=f"{RESULTS}/coupling/pressures.csv",
    output:
        table=table("patch_intervals", "3 Coupling"),
    log:
        f"{RESULTS}/logs/bound_pressures.log",
    params:
        **LOAD,
        material=config["material"],
        patch_mm=PATCH_MM,
        uncertainty=config["uncertainty"] | {"force_point_mm": FORCE_POINT_MM},
        seed=config["seed"],
        code=code("bound_pressures.py"),
    message:
        "Pressing the stone again and again for the intervals of the patches' pressures"
    script:
        "../scripts/bound_pressures.py"


if config["published"] is not None:

    rule compare_published:
        input:
            published=config["published"],
            path=f"{RESULTS}/tables/macroscale_path.csv",
            pressures=f"{RESULTS}/coupling/pressures.csv",
        output:
            table=table("published", "3 Coupling"),
        log:
            f"{RESULTS}/logs/compare_published.log",
        params:
            code=code("compare_published.py"),
        message:
            "Comparing computed with published figures"
        script:
            "../scripts/compare_published.py"


if REFERENCE:

    rule solve_reference:
        input:
            face=FACE,
            composite=COMPOSITE,
            macroscale=f"{RESULTS}/macroscale/contact.h5",
            t0=surfaces("T0", ALL_PATCHES),
            true_surface=f"{RESULTS}/specimen/surface.h5" if GENERATED else [],
            truth=f"{RESULTS}/specimen/truth.h5" if GENERATED else [],
        output:
            contact=f"{RESULTS}/reference/contact.h5",
            patches=f"{RESULTS}/reference/patches.h5",
        log:
            f"{RESULTS}/logs/solve_reference.log",
        params:
            draws=config["reference_draws"],
            s_filter_um=config["microscale"]["s_filter_um"],
            seed=config["seed"],
            code=code("solve_reference.py"),
        message:
            "Pressing the whole square at the scans' resolution"
        script:
            "../scripts/solve_reference.py"

    rule compare_scales:
        input:
            reference=f"{RESULTS}/reference/patches.h5",
            contacts=contacts(ALL_PATCHES),
            others=other_contacts(ALL_PATCHES),
        output:
            table=table("two_scales", "3 Coupling"),
        log:
            f"{RESULTS}/logs/compare_scales.log",
        params:
            patches=ALL_PATCHES,
            variants=VARIANTS,
            code=code("compare_scales.py"),
        message:
            "Comparing the patches with the contact of the whole square"
        script:
            "../scripts/compare_scales.py"
