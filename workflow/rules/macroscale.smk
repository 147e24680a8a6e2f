# The inputs, and the stone at rest under its load.
# Takes: the mesh and every scan. Gives: a summary of their contents, the heights of the use-face on
# a grid, and its contact at every load step.


# Reports everything wrong with the files at once, before any work. No rule takes its output as
# input, or all would rerun with it. It goes first by its priority, and alone because it asks for
# more cores than there are; if it fails, no other rule starts.
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
    threads: 64
    params:
        uses=SCAN_USES,
        mesh_unit=MESH_UNIT,
        square=config["square"],
        grid=GRID,
        scan_settings=config["scans"],
        maximum_unmeasured=config["preprocessing"]["maximum_unmeasured"],
        placed=bool(COMPOSITE),
        reference=REFERENCE,
        mat=config["mat"],
        second_stone=SECOND_STONE,
        code=code("check_inputs.py"),
    message:
        "Checking every file of the study"
    script:
        "../scripts/check_inputs.py"


rule grid_macroscale:
    input:
        mesh=MESH,
        counterface=COUNTERFACE_MESH,
    output:
        **({"second": SECOND} if SECOND else {}),
        face=FACE,
        table=table("gridding", "2 Macroscale"),
    log:
        f"{RESULTS}/logs/grid_macroscale.log",
    params:
        **GRID,
        **config["square"],
        interpolation=config["macroscale"]["interpolation"],
        mesh_unit=MESH_UNIT,
        second_stone=SECOND_STONE,
        code=code("grid_macroscale.py"),
    message:
        "Interpolating {input.mesh} on the square and the face around it"
    script:
        "../scripts/grid_macroscale.py"


if COMPOSITE:

    rule compose_surface:
        input:
            face=FACE,
            t0=surfaces("T0", ALL_PATCHES),
        output:
            composite=COMPOSITE,
        log:
            f"{RESULTS}/logs/compose_surface.log",
        params:
            patches=PLACES,
            patch_mm=PATCH_MM,
            s_filter_um=config["microscale"]["s_filter_um"],
            placement_um=config["uncertainty"]["placement_um"],
            seed=config["seed"],
            code=code("compose_surface.py"),
        message:
            "Laying the scans on the mesh"
        script:
            "../scripts/compose_surface.py"


rule solve_macroscale:
    input:
        face=PRESSED_FACE,
    output:
        contact=f"{RESULTS}/macroscale/contact.h5",
        path=table("macroscale_path", "2 Macroscale"),
    log:
        f"{RESULTS}/logs/solve_macroscale.log",
    params:
        **{
            name: config["macroscale"][name]
            for name in ("steps", "tolerance", "maximum_displacement_um")
        },
        **LOAD,
        patch_mm=PATCH_MM,
        contact_modulus_MPa=CONTACT_MODULUS_MPA,
        code=code("solve_macroscale.py"),
    message:
        "Pressing the stone with {params.force_N} N"
    script:
        "../scripts/solve_macroscale.py"
