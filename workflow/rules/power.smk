# How often does the study find a relation that is there, and one that is not? `make power`.
# Takes: the config's own sections. Gives: for many generated specimens the p-values of every test,
# with wear on summits and placed at random, and how often each test makes a claim.

if GENERATED and config["power"] is not None:

    POWER_SEEDS = [
        config["power"]["first_seed"] + place for place in range(config["power"]["specimens"])
    ]

    rule power:
        input:
            f"{RESULTS}/tables/power.csv",
            f"{RESULTS}/figures/power.png",

    # One job for each specimen, from its making to its scores: to start a job for each stage and
    # patch would take ten times as long as the work.
    rule try_specimen:
        input:
            patches=config["patches"],
        output:
            tests=f"{RESULTS}/power/{{seed}}_p_values.csv",
            scores=f"{RESULTS}/power/{{seed}}_patches.csv",
        log:
            f"{RESULTS}/logs/try_specimen/{{seed}}.log",
        benchmark:
            f"{RESULTS}/benchmarks/try_specimen/{{seed}}.tsv"
        wildcard_constraints:
            seed="[0-9]+",
        threads: 1
        resources:
            mem_mb=2000,
            runtime=30,
        params:
            patches=PATCHES.loc[WORN_PATCHES].to_dict("list"),
            patch_mm=PATCH_MM,
            contact_modulus_MPa=CONTACT_MODULUS_MPA,
            sections={
                name: config[name]
                for name in (
                    *("specimen", "square", "macroscale", "scans", "preprocessing"),
                    *("registration", "traces", "selection", "microscale", "validation"),
                )
            },
            code=code("try_specimen.py"),
        message:
            "Specimen {wildcards.seed} through the study, with either placement of its wear"
        script:
            "../scripts/try_specimen.py"

    rule rate_claims:
        input:
            tests=expand(f"{RESULTS}/power/{{seed}}_p_values.csv", seed=POWER_SEEDS),
        output:
            p_values=f"{RESULTS}/tables/power_p_values.csv",
            rates=report(
                f"{RESULTS}/tables/power.csv",
                caption="../report/power_table.rst",
                category="7 Power",
                labels={"what": "table: how often each test makes a claim"},
            ),
        log:
            f"{RESULTS}/logs/rate_claims.log",
        benchmark:
            f"{RESULTS}/benchmarks/rate_claims.tsv"
        threads: 1
        resources:
            mem_mb=1000,
            runtime=10,
        params:
            code=code("rate_claims.py"),
        message:
            "Counting the claims"
        script:
            "../scripts/rate_claims.py"

    rule plot_power:
        input:
            rates=rules.rate_claims.output.rates,
        output:
            power=picture("power", "7 Power", "claims where there is a relation and where not"),
            power_svg=vector("power"),
        log:
            f"{RESULTS}/logs/plot_power.log",
        benchmark:
            f"{RESULTS}/benchmarks/plot_power.tsv"
        threads: 1
        resources:
            mem_mb=1000,
            runtime=10,
        params:
            note=SOURCE_NOTE,
            code=code("plot_power.py"),
        message:
            "Drawing how often each test makes a claim"
        script:
            "../scripts/plot_power.py"
