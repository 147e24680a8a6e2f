# Pictures, from stored results only.
# Takes: HDF5 and tables of every stage. Gives: PNG (in the report) and SVG of each figure.


rule plot_macroscale:
    input:
        contact=rules.solve_macroscale.output.contact,
        pressures=f"{RESULTS}/tables/patch_pressures.csv",
    output:
        inputs=picture("inputs", "1 Inputs", "square and scanned patches"),
        inputs_svg=vector("inputs"),
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
        mem_mb=1500,
        runtime=10,
    params:
        patch_mm=PATCH_MM,
        note=SOURCE_NOTE,
        code=code("plot_macroscale.py"),
    message:
        "Drawing the macroscale"
    script:
        "../scripts/plot_macroscale.py"


rule plot_microscale:
    input:
        contacts=for_studied_patches("{results}/microscale/{patch}.h5"),
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
        mem_mb=2000,
        runtime=10,
    params:
        patches=lambda wildcards: studied_patches(),
        note=SOURCE_NOTE,
        code=code("plot_microscale.py"),
    message:
        "Drawing the microscale"
    script:
        "../scripts/plot_microscale.py"


rule plot_preparation:
    input:
        surfaces=lambda wildcards: expand(
            f"{RESULTS}/surfaces/{{patch}}_{{epoch}}.h5",
            patch=wildcards.patch,
            epoch=epochs_of(wildcards.patch),
        ),
    output:
        preparation=picture(
            "preparation/{patch}", "1 Inputs", "preparation of the scans", patch="{patch}"
        ),
        preparation_svg=vector("preparation/{patch}"),
    log:
        f"{RESULTS}/logs/plot_preparation/{{patch}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/plot_preparation/{{patch}}.tsv"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        epochs=lambda wildcards: epochs_of(wildcards.patch),
        note=SOURCE_NOTE,
        code=code("plot_preparation.py"),
    message:
        "Drawing the preparation of patch {wildcards.patch}"
    script:
        "../scripts/plot_preparation.py"


rule plot_patch:
    input:
        contact=f"{RESULTS}/microscale/{{patch}}.h5",
        registered=f"{RESULTS}/registered/{{patch}}.h5",
    output:
        patch=picture("patch/{patch}", "5 Validation", "before, predicted, after", patch="{patch}"),
        patch_svg=vector("patch/{patch}"),
    log:
        f"{RESULTS}/logs/plot_patch/{{patch}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/plot_patch/{{patch}}.tsv"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        note=SOURCE_NOTE,
        code=code("plot_patch.py"),
    message:
        "Drawing patch {wildcards.patch} before use, as predicted and after use"
    script:
        "../scripts/plot_patch.py"


rule plot_validation:
    input:
        patches=rules.score_patches.output.patches,
        summary=rules.score_patches.output.summary,
        microscale=rules.gather_microscale.output.summary,
    output:
        validation=picture("validation", "5 Validation", "scores against the rival"),
        validation_svg=vector("validation"),
    log:
        f"{RESULTS}/logs/plot_validation.log",
    benchmark:
        f"{RESULTS}/benchmarks/plot_validation.tsv"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        note=SOURCE_NOTE,
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
            mem_mb=1000,
            runtime=10,
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
            mem_mb=1000,
            runtime=10,
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
        mem_mb=1500,
        runtime=10,
    params:
        patch=lambda wildcards: hardest_pressed(),
        patch_mm=PATCH_MM,
        note=SOURCE_NOTE,
        code=code("plot_overview.py"),
    message:
        "Drawing the study at a glance"
    script:
        "../scripts/plot_overview.py"
