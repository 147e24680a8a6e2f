# Beyond frictionless elastic contact, where the config asks for it.
# Takes: the contact of each patch in the study. Gives: where it sticks and slips under a tangential
# load (`grinding`); the contact with a ceiling on its pressure (`hardness`).

if config["grinding"] is not None:

    rule solve_slip:
        input:
            contacts=for_studied_patches("{results}/microscale/{patch}.h5"),
        output:
            slips=directory(f"{RESULTS}/slip"),
            table=report(
                f"{RESULTS}/tables/slip.csv",
                caption="../report/slip.rst",
                category="4 Microscale",
                labels={"what": "table: stick and slip"},
            ),
        log:
            f"{RESULTS}/logs/solve_slip.log",
        benchmark:
            f"{RESULTS}/benchmarks/solve_slip.tsv"
        threads: 1
        resources:
            mem_mb=memory_mb,
            runtime=minutes,
        params:
            patches=lambda wildcards: studied_patches(),
            friction=config["grinding"]["friction"],
            tangential_ratio=config["grinding"]["tangential_ratio"],
            poisson=study_poisson(config["material"]),
            code=code("solve_slip.py"),
        message:
            "Loading the patches tangentially"
        script:
            "../scripts/solve_slip.py"


if config["hardness"] is not None:

    rule solve_hardness:
        input:
            contacts=for_studied_patches("{results}/microscale/{patch}.h5"),
        output:
            limited=directory(f"{RESULTS}/hardness"),
            table=report(
                f"{RESULTS}/tables/hardness.csv",
                caption="../report/hardness.rst",
                category="4 Microscale",
                labels={"what": "table: with a ceiling on the pressure"},
            ),
        log:
            f"{RESULTS}/logs/solve_hardness.log",
        benchmark:
            f"{RESULTS}/benchmarks/solve_hardness.tsv"
        threads: 1
        resources:
            mem_mb=memory_mb,
            runtime=minutes,
        params:
            patches=lambda wildcards: studied_patches(),
            hardness_MPa=config["hardness"],
            code=code("solve_hardness.py"),
        message:
            "Pressing the patches with no more than {params.hardness_MPa} MPa anywhere"
        script:
            "../scripts/solve_hardness.py"
