# Pictures, from stored results only.
# Takes: HDF5 and tables of every stage. Gives: PNG (in the report) and SVG of each figure.


rule plot_macroscale:
    input:
        contact=rules.solve_macroscale.output.contact,
        pressures=f"{RESULTS}/tables/patch_pressures.csv",
        intervals=rules.bound_pressures.output.table,
    output:
        contact_steps=picture("contact_steps", "2 Macroscale", "contact as the load grows"),
        contact_steps_svg=vector("contact_steps"),
        elastic_rigid=picture(
            "elastic_rigid", "2 Macroscale", "elastic contact and rigid interpenetration"
        ),
        elastic_rigid_svg=vector("elastic_rigid"),
        macroscale_curves=picture("macroscale_curves", "2 Macroscale", "area and pressure curves"),
        macroscale_curves_svg=vector("macroscale_curves"),
        forces=picture("forces", "3 Coupling", "contact forces under the patches"),
        forces_svg=vector("forces"),
        patch_pressures=picture("patch_pressures", "3 Coupling", "pressure of every patch"),
        patch_pressures_svg=vector("patch_pressures"),
    log:
        f"{RESULTS}/logs/plot_macroscale.log",
    benchmark:
        f"{RESULTS}/benchmarks/plot_macroscale.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        patch_mm=PATCH_MM,
        note=SOURCE_NOTE,
        code=code("plot_macroscale.py"),
    message:
        "Drawing the macroscale"
    script:
        "../scripts/plot_macroscale.py"


rule plot_placement:
    input:
        surface=rules.grid_macroscale.output.surface,
        placement=rules.place_patches.output.table,
        maps=rules.place_patches.output.maps,
    output:
        placement=picture("placement", "3 Coupling", "where the patches lie"),
        placement_svg=vector("placement"),
    log:
        f"{RESULTS}/logs/plot_placement.log",
    benchmark:
        f"{RESULTS}/benchmarks/plot_placement.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        patches=PATCHES.to_dict("list"),
        patch_mm=PATCH_MM,
        note=SOURCE_NOTE,
        code=code("plot_placement.py"),
    message:
        "Drawing where the patches lie"
    script:
        "../scripts/plot_placement.py"


rule plot_microscale:
    input:
        contacts=for_drawn_patches("{results}/microscale/{patch}.h5"),
    output:
        microscale_maps=picture("microscale_maps", "4 Microscale", "contact of every patch"),
        microscale_maps_svg=vector("microscale_maps"),
        microscale_curves=picture("microscale_curves", "4 Microscale", "area and pressure curves"),
        microscale_curves_svg=vector("microscale_curves"),
    log:
        f"{RESULTS}/logs/plot_microscale.log",
    benchmark:
        f"{RESULTS}/benchmarks/plot_microscale.tsv"
    threads: 1
    resources:
        mem_mb=memory_of_all_mb,
        runtime=minutes,
    params:
        patches=lambda wildcards: drawn_patches(),
        note=lambda wildcards: note_on(drawn_patches(), studied_patches()),
        code=code("plot_microscale.py"),
    message:
        "Drawing the microscale"
    script:
        "../scripts/plot_microscale.py"


if config["grinding"] is not None:

    rule plot_slip:
        input:
            contacts=for_drawn_patches("{results}/microscale/{patch}.h5"),
            slips=rules.solve_slip.output.slips,
        output:
            slip=picture("slip", "4 Microscale", "stick and slip"),
            slip_svg=vector("slip"),
        log:
            f"{RESULTS}/logs/plot_slip.log",
        benchmark:
            f"{RESULTS}/benchmarks/plot_slip.tsv"
        threads: 1
        resources:
            mem_mb=memory_of_all_mb,
            runtime=minutes,
        params:
            patches=lambda wildcards: drawn_patches(),
            note=lambda wildcards: note_on(drawn_patches(), studied_patches()),
            code=code("plot_slip.py"),
        message:
            "Drawing stick and slip"
        script:
            "../scripts/plot_slip.py"


if config["hardness"] is not None:

    rule plot_hardness:
        input:
            contacts=for_drawn_patches("{results}/microscale/{patch}.h5"),
            limited=rules.solve_hardness.output.limited,
        output:
            hardness=picture("hardness", "4 Microscale", "with a ceiling on the pressure"),
            hardness_svg=vector("hardness"),
        log:
            f"{RESULTS}/logs/plot_hardness.log",
        benchmark:
            f"{RESULTS}/benchmarks/plot_hardness.tsv"
        threads: 1
        resources:
            mem_mb=memory_of_all_mb,
            runtime=minutes,
        params:
            patches=lambda wildcards: drawn_patches(),
            note=lambda wildcards: note_on(drawn_patches(), studied_patches()),
            code=code("plot_hardness.py"),
        message:
            "Drawing the contacts with a ceiling on the pressure"
        script:
            "../scripts/plot_hardness.py"


DRAWN_SCANS = drawn(list(PATCHES.index))


# All patches in one job: to start matplotlib takes half as long as to draw a patch.
rule plot_preparation:
    input:
        t0=expand(f"{RESULTS}/surfaces/{{patch}}_T0.h5", patch=DRAWN_SCANS),
        t1=expand(
            f"{RESULTS}/surfaces/{{patch}}_T1.h5",
            patch=[p for p in DRAWN_SCANS if p in WORN_PATCHES],
        ),
    output:
        preparation=pictures("preparation", "1 Inputs", "preparation of the scans"),
    log:
        f"{RESULTS}/logs/plot_preparation.log",
    benchmark:
        f"{RESULTS}/benchmarks/plot_preparation.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        patches=DRAWN_SCANS,
        worn=[p for p in DRAWN_SCANS if p in WORN_PATCHES],
        note=SOURCE_NOTE,
        code=code("plot_preparation.py"),
    message:
        "Drawing the preparation of the scans"
    script:
        "../scripts/plot_preparation.py"


rule plot_patches:
    input:
        contacts=for_drawn_patches("{results}/microscale/{patch}.h5", only=WORN_PATCHES),
        registered=for_drawn_patches("{results}/registered/{patch}.h5", only=WORN_PATCHES),
    output:
        patch=pictures("patch", "5 Validation", "before, predicted, after"),
    log:
        f"{RESULTS}/logs/plot_patches.log",
    benchmark:
        f"{RESULTS}/benchmarks/plot_patches.tsv"
    threads: 1
    resources:
        mem_mb=memory_of_all_mb,
        runtime=minutes,
    params:
        patches=lambda wildcards: drawn_patches(WORN_PATCHES),
        note=SOURCE_NOTE,
        code=code("plot_patches.py"),
    message:
        "Drawing the patches before use, as predicted and after use"
    script:
        "../scripts/plot_patches.py"


rule plot_validation:
    input:
        contacts=for_drawn_patches("{results}/microscale/{patch}.h5", only=WORN_PATCHES),
        registered=for_drawn_patches("{results}/registered/{patch}.h5", only=WORN_PATCHES),
        microscale=rules.gather_microscale.output.summary,
        patches=rules.score_patches.output.patches,
        gains=rules.score_patches.output.gains,
        failures=rules.score_patches.output.failures,
        summary=rules.score_patches.output.summary,
    output:
        validation=picture("validation", "5 Validation", "prediction against loss, chance, rivals"),
        validation_svg=vector("validation"),
    log:
        f"{RESULTS}/logs/plot_validation.log",
    benchmark:
        f"{RESULTS}/benchmarks/plot_validation.tsv"
    threads: 1
    resources:
        mem_mb=memory_of_all_mb,
        runtime=minutes,
    params:
        patches=lambda wildcards: drawn_patches(WORN_PATCHES),
        note=lambda wildcards: note_on(
            drawn_patches(WORN_PATCHES), [p for p in studied_patches() if p in WORN_PATCHES]
        ),
        code=code("plot_validation.py"),
    message:
        "Drawing the validation"
    script:
        "../scripts/plot_validation.py"


if GENERATED:

    rule plot_truth:
        input:
            truth=rules.score_truth.output.table,
        output:
            truth=picture("truth", "6 Against the truth", "recovered against true"),
            truth_svg=vector("truth"),
        log:
            f"{RESULTS}/logs/plot_truth.log",
        benchmark:
            f"{RESULTS}/benchmarks/plot_truth.tsv"
        threads: 1
        resources:
            mem_mb=memory_mb,
            runtime=minutes,
        params:
            note=SOURCE_NOTE,
            code=code("plot_truth.py"),
        message:
            "Drawing what was recovered against the truth"
        script:
            "../scripts/plot_truth.py"


if config["published"] is not None:

    rule plot_published:
        input:
            published=rules.compare_published.output.table,
        output:
            published=picture("published", "3 Coupling", "published against computed"),
            published_svg=vector("published"),
        log:
            f"{RESULTS}/logs/plot_published.log",
        benchmark:
            f"{RESULTS}/benchmarks/plot_published.tsv"
        threads: 1
        resources:
            mem_mb=memory_mb,
            runtime=minutes,
        params:
            note=SOURCE_NOTE,
            code=code("plot_published.py"),
        message:
            "Drawing published against computed figures"
        script:
            "../scripts/plot_published.py"


rule plot_overview:
    input:
        macroscale=rules.solve_macroscale.output.contact,
        pressures=f"{RESULTS}/tables/patch_pressures.csv",
        contact=lambda wildcards: f"{RESULTS}/microscale/{hardest_pressed()}.h5",
        registered=registered_of_hardest_pressed,
    output:
        overview=picture("overview", "0 Overview", "the study at a glance"),
        overview_svg=vector("overview"),
    log:
        f"{RESULTS}/logs/plot_overview.log",
    benchmark:
        f"{RESULTS}/benchmarks/plot_overview.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        patch=lambda wildcards: hardest_pressed(),
        patch_mm=PATCH_MM,
        note=SOURCE_NOTE,
        code=code("plot_overview.py"),
    message:
        "Drawing the study at a glance"
    script:
        "../scripts/plot_overview.py"
