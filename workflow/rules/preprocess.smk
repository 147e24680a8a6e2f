# The inputs: checked, and made ready.
# Takes: the mesh and every scan. Gives: a summary of their contents, the heights of the use-face on a
# grid, and clean scans.


# Reports everything wrong with the files at once, before any other step reads one: each of those
# waits for `passed`. It is empty, and kept while the files are checked again, so that nothing but
# what reads a changed file runs again.
rule check_inputs:
    input:
        mesh=MESH,
        counterface=COUNTERFACE_MESH,
        scans=SCANS,
    output:
        table=table("inputs", "1 Inputs") if SCANNED else f"{RESULTS}/tables/inputs.csv",
        passed=update(f"{RESULTS}/logs/inputs_passed"),
    log:
        f"{RESULTS}/logs/check_inputs.log",
    resources:
        mem_mb=growing(600, scan=60, mesh=12),
        runtime=growing(10, scans=0.1),
    params:
        uses=SCAN_USES,
        asked={
            "mesh_unit": MESH_UNIT,
            "square": config["square"],
            "grid": GRID,
            "scan_settings": config["scans"],
            "maximum_unmeasured": config["preprocessing"]["maximum_unmeasured"],
            "placed": PLACED and SCANNED,
            "reference": REFERENCE,
            "mat": config["mat"],
            "second_stone": SECOND_STONE,
        },
        code=code("check_inputs.py"),
    message:
        "Checking every file of the study"
    script:
        "../scripts/check_inputs.py"


rule grid_macroscale:
    input:
        ancient(rules.check_inputs.output.passed),
        mesh=MESH,
        counterface=COUNTERFACE_MESH,
    output:
        **({"second": f"{RESULTS}/macroscale/second_stone.h5"} if SECOND_STONE else {}),
        face=f"{RESULTS}/macroscale/surface.h5",
        table=table("gridding", "2 Macroscale"),
    log:
        f"{RESULTS}/logs/grid_macroscale.log",
    resources:
        mem_mb=growing(600, mesh=14),
    params:
        gridding=GRID | config["square"] | {"interpolation": config["macroscale"]["interpolation"]},
        mesh_unit=MESH_UNIT,
        second_stone=SECOND_STONE,
        code=code("grid_macroscale.py"),
    message:
        "Interpolating {input.mesh} on the square and the face around it"
    script:
        "../scripts/grid_macroscale.py"


SECOND = rules.grid_macroscale.output.second if SECOND_STONE else []


def of_batch(column):
    """What a column of the patch table says of each patch of a batch."""
    return lambda wildcards: [
        PATCHES[column][patch] for patch in SCANNED_BATCHES[wildcards.epoch][wildcards.batch]
    ]


def scans_of_batch(wildcards):
    ids = SCANNED_BATCHES[wildcards.epoch][wildcards.batch]
    return [f"{SCAN_FOLDER}/{PATCHES[wildcards.epoch.lower()][patch]}" for patch in ids]


def crops_of_batch(wildcards):
    """Centre [y, x] in mm of the piece to cut from each scan, or None for a whole scan."""
    ids = SCANNED_BATCHES[wildcards.epoch][wildcards.batch]
    crops = PATCHES.loc[ids, ["crop_y_mm", "crop_x_mm"]].itertuples(index=False)
    return [None if y != y else [float(y), float(x)] for y, x in crops]


rule prepare_scans:
    input:
        ancient(rules.check_inputs.output.passed),
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


def surfaces(epoch):
    """The folders with the clean scans at an epoch; and that of a batch."""
    batches = list(SCANNED_BATCHES[epoch])
    return expand(rules.prepare_scans.output.surfaces, epoch=epoch, batch=batches)


def surfaces_of_batch(epoch):
    return expand(rules.prepare_scans.output.surfaces, epoch=epoch, allow_missing=True)


if COUNTERFACE_SCAN:

    rule prepare_counterface:
        input:
            ancient(rules.check_inputs.output.passed),
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
            "Tabulating what was done to each scan"
        script:
            "../scripts/tabulate_preprocessing.py"
