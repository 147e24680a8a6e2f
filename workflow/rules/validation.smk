# Was the prediction right?
# Takes: predicted contact, and T1 laid over T0. Gives: scores per patch and over the patches, each
# against chance and against rivals that need no mechanics.

EXPECTED_WORST = config["validation"]["expected_worst"]


rule score_patches:
    input:
        contacts=for_studied_patches("{results}/microscale/{patch}.h5", only=WORN_PATCHES),
        registered=for_studied_patches("{results}/registered/{patch}.h5", only=WORN_PATCHES),
        microscale=f"{RESULTS}/tables/microscale_summary.csv",
    output:
        patches=report(
            f"{RESULTS}/tables/validation_patches.csv",
            caption="../report/validation_patches.rst",
            category="5 Validation",
            labels={"what": "table: scores of each patch"},
        ),
        gains=report(
            f"{RESULTS}/tables/validation_gains.csv",
            caption="../report/validation_gains.rst",
            category="5 Validation",
            labels={"what": "table: scores against chance and best rival"},
        ),
        failures=report(
            f"{RESULTS}/tables/validation_failures.csv",
            caption="../report/validation_failures.rst",
            category="5 Validation",
            labels={"what": "table: where the prediction fails"},
        ),
        summary=report(
            f"{RESULTS}/tables/validation_summary.csv",
            caption="../report/validation_summary.rst",
            category="5 Validation",
            labels={"what": "table: over all patches"},
        ),
    log:
        f"{RESULTS}/logs/score_patches.log",
    benchmark:
        f"{RESULTS}/benchmarks/score_patches.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        patches=lambda wildcards: [p for p in studied_patches() if p in WORN_PATCHES],
        validation={
            key: value for key, value in config["validation"].items() if key != "expected_worst"
        },
        places=PATCHES[["x_mm", "y_mm"]].T.to_dict("list"),
        # a claim about other patches is none about these
        worst=EXPECTED_WORST if set(EXPECTED_WORST) <= set(PATCHES.index) else [],
        code=code("score_patches.py"),
    message:
        "Scoring predicted contact against measured height loss"
    script:
        "../scripts/score_patches.py"
