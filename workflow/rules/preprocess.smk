# The inputs: checked, and made ready.
# Takes: the mesh and every scan. Gives: a summary of their contents, the heights of the use-face on a
# grid, and clean scans.


# Reports everything wrong with the files at once, before any work.
rule check_inputs:
    input:
        mesh=MESH,
        counterface=COUNTERFACE_MESH,
        scans=SCANS,
    output:
        table=table("inputs", "1 Inputs") if SCANNED else f"{RESULTS}/tables/inputs.csv",
    log:
        f"{RESULTS}/logs/check_inputs.log",
    priority: 100
    resources:
        mem_mb=growing(600, scan=60, mesh=12),
        runtime=growing(10, scans=0.1),
    params:
        uses=SCAN_USES,
        asked=asked_of_files(config, MESH_UNIT, ACTIVE_TOOL),
        code=code("check_inputs.py"),
    message:
        "Checking every file of the study"
    script:
        "../scripts/check_inputs.py"


# Every step that reads a file waits for this one. It is made once: when files are checked again,
# nothing but what reads a changed one runs again. (`ancient` would do, but Snakemake 9 then overlooks
# steps that have to run for another reason.)
PASSED = f"{RESULTS}/logs/inputs_passed"


if not os.path.exists(PASSED):

    rule pass_inputs:
        input:
            rules.check_inputs.output.table,
        output:
            touch(PASSED),


rule grid_macroscale:
    input:
        PASSED,
        mesh=MESH,
        counterface=COUNTERFACE_MESH,
    output:
        **({"second": f"{RESULTS}/macroscale/active_tool.h5"} if ACTIVE_TOOL else {}),
        face=f"{RESULTS}/macroscale/surface.h5",
        table=table("gridding", "2 Macroscale"),
    log:
        f"{RESULTS}/logs/grid_macroscale.log",
    resources:
        mem_mb=growing(600, mesh=14),
    params:
        rounded=rounded_form(config),
        gridding=SETTINGS["grid_macroscale"],
        mesh_unit=MESH_UNIT,
        active_tool=ACTIVE_TOOL,
        code=code("grid_macroscale.py"),
    message:
        "Interpolating {input.mesh} on the square and the face around it"
    script:
        "../scripts/grid_macroscale.py"


SECOND = rules.grid_macroscale.output.second if ACTIVE_TOOL else []


rule prepare_scans:
    input:
        PASSED,
        scans=scans_of_batch,
    output:
        surfaces=directory(f"{RESULTS}/surfaces/{{epoch}}/{{batch}}"),
    log:
        f"{RESULTS}/logs/prepare_scans_{{epoch}}_{{batch}}.log",
    resources:
        mem_mb=growing(500, scan=100),
        runtime=growing(10, batch=0.5),
    params:
        patches=of_batch("patch"),
        epoch="{epoch}",
        crops=crops_of_batch,
        flips=of_batch("flip"),
        settings=config["scans"],
        preprocessing=config["preprocessing"],
        code=code("prepare_scans.py"),
    message:
        f"Cleaning the scans at {{wildcards.epoch}}: part {{wildcards.batch}} of {len(BATCHES)}"
    script:
        "../scripts/prepare_scans.py"


if COUNTERFACE_SCAN:

    rule prepare_counterface:
        input:
            PASSED,
            scan=COUNTERFACE_SCAN,
        output:
            surface=f"{RESULTS}/surfaces/counterface.h5",
        log:
            f"{RESULTS}/logs/prepare_counterface.log",
        resources:
            mem_mb=growing(500, scan=100),
        params:
            settings=config["scans"],
            preprocessing=config["preprocessing"],
            code=code("prepare_counterface.py"),
        message:
            "Cleaning the scan of the counterface"
        script:
            "../scripts/prepare_counterface.py"


if SCANNED:

    rule tabulate_preprocessing:
        input:
            t0=surfaces("T0"),
            t1=surfaces("T1"),
            repeats=surfaces("repeat"),
        output:
            table=table("preprocessing", "1 Inputs"),
        log:
            f"{RESULTS}/logs/tabulate_preprocessing.log",
        params:
            patches=ALL_PATCHES,
            code=code("tabulate_preprocessing.py"),
        message:
            "Tabulating the cleaning of each scan"
        script:
            "../scripts/tabulate_preprocessing.py"
