# The stone at rest under its load, and in the poses of a gesture.
# Takes: the use-face on its grid, and the scans that are laid on it. Gives: its contact at every load
# step, that of the paper's square alone, and the exposure that all poses of a gesture leave; before
# anything is scanned, places to scan.

import numpy as np

PLACES = columns("patch", "x_mm", "y_mm", "rotation_deg")
# What is pressed: the mesh alone, or the scans laid on it.
COMPOSITE = []
PRESSED_FACE = rules.grid_macroscale.output.face


if EQUILIBRIUM and SCANNED:

    rule compose_surface:
        input:
            face=rules.grid_macroscale.output.face,
            t0=surfaces("T0"),
        output:
            composite=f"{RESULTS}/macroscale/composite.h5",
        log:
            f"{RESULTS}/logs/compose_surface.log",
        resources:
            mem_mb=growing(500, scan=100),
        params:
            **SETTINGS["compose_surface"],
            patches=PLACES,
            code=code("compose_surface.py"),
        message:
            "Positioning the scans on the mesh"
        script:
            "../scripts/compose_surface.py"

    COMPOSITE = PRESSED_FACE = rules.compose_surface.output.composite


rule solve_macroscale:
    input:
        face=PRESSED_FACE,
        use=inferred_use,
    output:
        contact=f"{RESULTS}/macroscale/contact.h5",
        path=table("macroscale_path", "2 Macroscale"),
    log:
        f"{RESULTS}/logs/solve_macroscale.log",
    params:
        **LOAD,
        solving={
            name: config["macroscale"][name]
            for name in ("tolerance", "steps", "maximum_displacement_um")
        },
        modulus=SETTINGS["solve_macroscale"]["modulus"],
        patch_mm=PATCH_MM,
        code=code("solve_macroscale.py"),
    message:
        f"Pressing the stone with {LOAD['force_N']:g} N"
    script:
        "../scripts/solve_macroscale.py"


# A study as in the paper presses nothing but the square.
SQUARE_CONTACT = rules.solve_macroscale.output.contact


if EQUILIBRIUM and SCANNED:

    rule solve_square:
        input:
            face=rules.grid_macroscale.output.face,
        output:
            contact=f"{RESULTS}/macroscale/square.h5",
        log:
            f"{RESULTS}/logs/solve_square.log",
        params:
            **SETTINGS["solve_square"],
            code=code("solve_square.py"),
        message:
            "Pressing the paper's square alone"
        script:
            "../scripts/solve_square.py"

    SQUARE_CONTACT = rules.solve_square.output.contact


# By batch. A batch takes as long to start as a hundred poses to press.
POSE_BATCHES = batches_of(POSES)
# Poses that a figure shows, in even steps.
SHOWN_POSES = 4
# The exposure that they leave.
EXPOSURE = []


if POSES is not None:

    rule press_poses:
        input:
            face=PRESSED_FACE,
            use=inferred_use,
            second=SECOND,
        output:
            batch=f"{RESULTS}/gesture/poses_{{batch}}.h5",
        log:
            f"{RESULTS}/logs/press_poses_{{batch}}.log",
        params:
            contact_modulus_MPa=SETTINGS["solve_macroscale"]["modulus"],
            tolerance=config["macroscale"]["tolerance"],
            patch_mm=PATCH_MM,
            size_mm=SQUARE_MM,
            load_point=LOAD["load_point"],
            poses=lambda wildcards: POSE_BATCHES[wildcards.batch],
            patches=PLACES,
            shown=[
                round(place)
                for place in np.linspace(0, len(POSES) - 1, min(len(POSES), SHOWN_POSES))
            ],
            code=code("press_poses.py"),
        message:
            f"Pressing the stone in {len(POSES)} poses: part {{wildcards.batch}} of {len(POSE_BATCHES)}"
        script:
            "../scripts/press_poses.py"

    rule gather_exposure:
        input:
            batches=expand(rules.press_poses.output.batch, batch=POSE_BATCHES),
            pressures=(lambda _: rules.couple_scales.output.pressures) if SCANNED else [],
        output:
            **({"table": table("exposure", "3 Coupling")} if SCANNED else {}),
            fields=f"{RESULTS}/gesture/exposure.h5",
        log:
            f"{RESULTS}/logs/gather_exposure.log",
        params:
            code=code("gather_exposure.py"),
        message:
            "Combining the poses"
        script:
            "../scripts/gather_exposure.py"

    EXPOSURE = rules.gather_exposure.output.fields


if not SCANNED:

    rule propose_places:
        input:
            exposure=EXPOSURE,
        output:
            table=table("places", "0 Overview"),
        log:
            f"{RESULTS}/logs/propose_places.log",
        params:
            size_mm=SQUARE_MM,
            patch_mm=PATCH_MM,
            code=code("propose_places.py"),
        message:
            "Proposing positions to scan"
        script:
            "../scripts/propose_places.py"

    rule colour_tool:
        input:
            mesh=MESH,
            face=rules.grid_macroscale.output.face,
            contact=rules.solve_macroscale.output.contact,
            exposure=EXPOSURE,
        output:
            tool=f"{RESULTS}/tool.ply",
        log:
            f"{RESULTS}/logs/colour_tool.log",
        resources:
            mem_mb=growing(600, mesh=15),
        params:
            mesh_unit=MESH_UNIT,
            code=code("colour_tool.py"),
        message:
            "Mapping pressure and exposure onto the tool: {output.tool}"
        script:
            "../scripts/colour_tool.py"
