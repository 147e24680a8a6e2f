# How often does the study find a relation that is there, and one that is not? `make power`.
# Takes: the config's own sections. Gives: for many generated specimens the p-values of every test, with wear
# on summits, placed at random and in long waves, of some also by Archard's law without and with a mat, and how often
# each test makes a claim.

if GENERATED and config["power"] is not None:
    FIRST_SEED = config["power"]["first_seed"]
    POWER_SEEDS = range(FIRST_SEED, FIRST_SEED + config["power"]["specimens"])

    rule power:
        input:
            f"{RESULTS}/tables/power.csv",

    # One job for each specimen, from its making to its scores: jobs for each stage and patch would take ten
    # times as long to start as to run.
    rule try_specimen:
        input:
            table=config["patches"],
        output:
            tests=f"{RESULTS}/power/{{seed}}_p_values.csv",
            scores=f"{RESULTS}/power/{{seed}}_patches.csv",
        log:
            f"{RESULTS}/logs/try_specimen/{{seed}}.log",
        params:
            specimen_seed=lambda wildcards: int(wildcards.seed),
            laws=lambda wildcards: int(wildcards.seed)
            < FIRST_SEED + config["power"]["law_specimens"],
            patches=PATCHES.loc[WORN_PATCHES].to_dict("list"),
            config={name: config[name] for name in ("seed", "specimen", *STUDY_SECTIONS)},
            code=code("try_specimen.py"),
        message:
            "Taking specimen {wildcards.seed} through the study, with each kind of its wear"
        script:
            "../scripts/try_specimen.py"

    rule rate_claims:
        input:
            tests=[f"{RESULTS}/power/{seed}_p_values.csv" for seed in POWER_SEEDS],
        output:
            p_values=f"{RESULTS}/tables/power_p_values.csv",
            rates=table("power", "8 Power", "how often each test makes a claim"),
        log:
            f"{RESULTS}/logs/rate_claims.log",
        params:
            code=code("rate_claims.py"),
        message:
            "Counting the claims"
        script:
            "../scripts/rate_claims.py"
