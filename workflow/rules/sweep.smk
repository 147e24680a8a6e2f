# What moves the results most? `make sweep`.
# Takes: the study's own inputs and stages. Gives: patch pressures, scores and texture with one
# thing set otherwise at a time, in one table and one figure.

if config["sweep"] is not None:
    SETTINGS = {setting.name: setting for setting in sweep_settings(config["sweep"])}

    rule sweep:
        input:
            f"{RESULTS}/tables/sweep.csv",
            f"{RESULTS}/figures/sweep.png",

    # One job for each setting, of all stages that depend on it: to start a job for each stage and
    # patch would take longer than the work.
    rule try_setting:
        input:
            mesh=MESH,
            t0_scans=scan_files("t0", PATCHES.index),
            t1_scans=scan_files("t1", WORN_PATCHES),
            counterface_scan=[] if COUNTERFACE is None else COUNTERFACE,
            surface=rules.grid_macroscale.output.surface,
            contact=rules.solve_macroscale.output.contact,
            pressures=f"{RESULTS}/tables/patch_pressures.csv",
            texture=rules.tabulate_texture.output.table,
            t0=expand(f"{RESULTS}/surfaces/{{patch}}_T0.h5", patch=PATCHES.index),
            t1=expand(f"{RESULTS}/surfaces/{{patch}}_T1.h5", patch=WORN_PATCHES),
            registered=expand(f"{RESULTS}/registered/{{patch}}.h5", patch=WORN_PATCHES),
            contacts=for_studied_patches("{results}/microscale/{patch}.h5", only=WORN_PATCHES),
            counterface=[] if COUNTERFACE is None else f"{RESULTS}/surfaces/counterface.h5",
        output:
            outcomes=f"{RESULTS}/sweep/{{setting}}.csv",
        log:
            f"{RESULTS}/logs/try_setting/{{setting}}.log",
        benchmark:
            f"{RESULTS}/benchmarks/try_setting/{{setting}}.tsv"
        wildcard_constraints:
            setting="|".join(map(re.escape, SETTINGS)),
        threads: 1
        resources:
            mem_mb=3000,
            runtime=60,
        params:
            patches=list(PATCHES.index),
            worn=WORN_PATCHES,
            studied=lambda wildcards: [p for p in studied_patches() if p in WORN_PATCHES],
            crops=crops_of(PATCHES.index),
            mesh_unit="mm" if GENERATED else config["inputs"]["mesh_unit"],
            base={name: config[name] for name in ("square", "scans", *SWEPT)},
            changes=lambda wildcards: SETTINGS[wildcards.setting].changes,
            code=code("try_setting.py"),
        message:
            "The study with {wildcards.setting}"
        script:
            "../scripts/try_setting.py"

    rule tabulate_sweep:
        input:
            outcomes=expand(f"{RESULTS}/sweep/{{setting}}.csv", setting=SETTINGS),
        output:
            table=report(
                f"{RESULTS}/tables/sweep.csv",
                caption="../report/sweep_table.rst",
                category="8 Sweep",
                labels={"what": "table: results with one thing set otherwise"},
            ),
        log:
            f"{RESULTS}/logs/tabulate_sweep.log",
        benchmark:
            f"{RESULTS}/benchmarks/tabulate_sweep.tsv"
        threads: 1
        resources:
            mem_mb=1000,
            runtime=10,
        params:
            sweep=config["sweep"],
            code=code("tabulate_sweep.py"),
        message:
            "Gathering the results of the sweep"
        script:
            "../scripts/tabulate_sweep.py"

    rule plot_sweep:
        input:
            table=rules.tabulate_sweep.output.table,
        output:
            sweep=picture("sweep", "8 Sweep", "what moves the results most"),
            sweep_svg=vector("sweep"),
        log:
            f"{RESULTS}/logs/plot_sweep.log",
        benchmark:
            f"{RESULTS}/benchmarks/plot_sweep.tsv"
        threads: 1
        resources:
            mem_mb=1000,
            runtime=10,
        params:
            note=SOURCE_NOTE,
            code=code("plot_sweep.py"),
        message:
            "Drawing what moves the results most"
        script:
            "../scripts/plot_sweep.py"
