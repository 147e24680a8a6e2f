# The synthetic specimen, if the config asks for one.
# Takes: the patch table. Gives: a mesh, scans before and after use, and the truth about them; without
# patches the mesh alone.

if GENERATED:

    rule generate_specimen:
        output:
            **(
                {"counterface": COUNTERFACE_MESH}
                if config["specimen"]["counterface_seed"] is not None
                else {}
            ),
            **(
                {name: f"{RESULTS}/specimen/{name}.h5" for name in ("truth", "surface")}
                if SCANNED
                else {}
            ),
            mesh=MESH,
            scans=[
                f"{SCAN_FOLDER}/{name}"
                for name in sorted({*PATCHES.t0, *PATCHES.t1, *PATCHES["repeat"]} - {""})
            ],
        log:
            f"{RESULTS}/logs/generate_specimen.log",
        resources:
            mem_mb=growing(500, scan=220, square=17),
            runtime=growing(10, scans=0.1),
        params:
            patches=columns("patch", "x_mm", "y_mm", "rotation_deg", "t0", "t1", "repeat"),
            specimen=config["specimen"],
            square_mm=SQUARE_MM,
            grid=config["macroscale"]["grid"],
            # with either coupling: the specimen stays the same
            around=elements_around(
                SQUARE_MM, config["macroscale"]["grid"], config["macroscale"]["face_mm"]
            ),
            code=code("generate_specimen.py"),
        message:
            "Making the specimen: a mesh, and its patches scanned before and after use"
            if SCANNED
            else "Making the specimen's mesh"
        script:
            "../scripts/generate_specimen.py"
