# What moves the results most? `make sweep`.
# Takes: the study's own inputs. Gives: patch pressures, scores and texture with one value changed
# at a time, in one table and one figure.

if config["sweep"] is not None:
    SETTINGS = {setting.name: setting for setting in sweep_settings(config["sweep"])}

    rule sweep:
        input:
            f"{RESULTS}/tables/sweep.csv",
            f"{RESULTS}/figures/sweep.png",

    # One job for each setting, with all stages: jobs for each stage and patch would take
    # longer to start than to run.
    rule try_setting:
        input:
            mesh=MESH,
            t0_scans=scans_at("t0", ALL_PATCHES),
            t1_scans=scans_at("t1", WORN_PATCHES),
            repeat_scans=scans_at("repeat", REPEATED_PATCHES),
            counterface_scan=COUNTERFACE_SCAN,
            counterface=COUNTERFACE_MESH,
        output:
            outcome=f"{RESULTS}/sweep/{{setting}}.csv",
        log:
            f"{RESULTS}/logs/try_setting/{{setting}}.log",
        params:
            patches=PATCHES.to_dict("list"),
            worn=WORN_PATCHES,
            repeated=REPEATED_PATCHES,
            mesh_unit=MESH_UNIT,
            second_stone=SECOND_STONE,
            config={name: config[name] for name in ("seed", *STUDY_SECTIONS)},
            changes=lambda wildcards: SETTINGS[wildcards.setting].changes,
            code=code("try_setting.py"),
        message:
            "The study with {wildcards.setting}"
        script:
            "../scripts/try_setting.py"

    rule tabulate_sweep:
        input:
            outcomes=[f"{RESULTS}/sweep/{setting}.csv" for setting in SETTINGS],
        output:
            table=table("sweep", "9 Sweep"),
        log:
            f"{RESULTS}/logs/tabulate_sweep.log",
        params:
            sweep=config["sweep"],
            code=code("tabulate_sweep.py"),
        message:
            "Tabulating the results of the sweep"
        script:
            "../scripts/tabulate_sweep.py"
