# The whole square against a flat.
# Takes: the mesh. Gives: its heights on a grid, and the contact at every load step.


rule grid_macroscale:
    input:
        mesh=MESH,
        marker=[] if MARKER is None else MARKER,
    output:
        surface=f"{RESULTS}/macroscale/surface.h5",
        table=report(
            f"{RESULTS}/tables/gridding.csv",
            caption="../report/gridding.rst",
            category="2 Macroscale",
            labels={"what": "table: gridding, two ways"},
        ),
    log:
        f"{RESULTS}/logs/grid_macroscale.log",
    benchmark:
        f"{RESULTS}/benchmarks/grid_macroscale.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        mesh_unit="mm" if GENERATED else config["inputs"]["mesh_unit"],
        square=config["square"],
        grid=config["macroscale"]["grid"],
        margin_mm=config["macroscale"]["margin_mm"],
        code=code("grid_macroscale.py"),
    message:
        "Interpolating {input.mesh} on the analysed square"
    script:
        "../scripts/grid_macroscale.py"


rule solve_macroscale:
    input:
        surface=rules.grid_macroscale.output.surface,
    output:
        contact=f"{RESULTS}/macroscale/contact.h5",
        path=report(
            f"{RESULTS}/tables/macroscale_path.csv",
            caption="../report/macroscale_path.rst",
            category="2 Macroscale",
            labels={"what": "table: load path"},
        ),
    log:
        f"{RESULTS}/logs/solve_macroscale.log",
    benchmark:
        f"{RESULTS}/benchmarks/solve_macroscale.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        contact_modulus_MPa=CONTACT_MODULUS_MPA,
        target_pressure_MPa=config["macroscale"]["target_pressure_MPa"],
        steps=config["macroscale"]["steps"],
        tolerance=config["macroscale"]["tolerance"],
        maximum_displacement_um=config["macroscale"]["maximum_displacement_um"],
        code=code("solve_macroscale.py"),
    message:
        "Pressing the square up to {params.target_pressure_MPa} MPa"
    script:
        "../scripts/solve_macroscale.py"
