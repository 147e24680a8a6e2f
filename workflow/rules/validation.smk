# Was the prediction right?
# Takes: predicted contact, and T1 laid over T0. Gives: scores per patch and over the patches.


rule score_patches:
    input:
        contacts=for_studied_patches("{results}/microscale/{patch}.h5", only=WORN_PATCHES),
        registered=for_studied_patches("{results}/registered/{patch}.h5", only=WORN_PATCHES),
        microscale=rules.gather_microscale.output.summary,
    output:
        patches=report(
            f"{RESULTS}/tables/validation_patches.csv",
            caption="../report/validation_patches.rst",
            category="5 Validation",
            labels={"what": "scores of each patch", "kind": "table"},
        ),
        summary=report(
            f"{RESULTS}/tables/validation_summary.csv",
            caption="../report/validation_summary.rst",
            category="5 Validation",
            labels={"what": "over all patches", "kind": "table"},
        ),
    log:
        f"{RESULTS}/logs/score_patches.log",
    benchmark:
        f"{RESULTS}/benchmarks/score_patches.tsv"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=20,
    params:
        patches=lambda wildcards: [p for p in studied_patches() if p in WORN_PATCHES],
        seed=config["validation"]["seed"],
        resamples=config["validation"]["resamples"],
        code=code("score_patches.py"),
    message:
        "Scoring predicted contact against measured height loss"
    script:
        "../scripts/score_patches.py"
