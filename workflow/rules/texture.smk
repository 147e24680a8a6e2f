# How rough is each patch, before and after use?
# Takes: clean surfaces, T1 laid over T0. Gives: texture parameters of each patch, and their change.


# All patches in one job: to start the library of texture parameters takes as long as five patches.
rule tabulate_texture:
    input:
        t0=expand(f"{RESULTS}/surfaces/{{patch}}_T0.h5", patch=PATCHES.index),
        registered=expand(f"{RESULTS}/registered/{{patch}}.h5", patch=WORN_PATCHES),
    output:
        table=report(
            f"{RESULTS}/tables/texture.csv",
            caption="../report/texture_table.rst",
            category="5 Validation",
            labels={"what": "table: surface texture before and after use"},
        ),
    log:
        f"{RESULTS}/logs/tabulate_texture.log",
    benchmark:
        f"{RESULTS}/benchmarks/tabulate_texture.tsv"
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        patches=list(PATCHES.index),
        worn=WORN_PATCHES,
        texture=config["texture"],
        code=code("tabulate_texture.py"),
    message:
        "Measuring the texture of the patches"
    script:
        "../scripts/tabulate_texture.py"


if WORN_PATCHES:

    rule plot_texture:
        input:
            texture=rules.tabulate_texture.output.table,
        output:
            texture=picture("texture", "5 Validation", "surface texture before and after use"),
            texture_svg=vector("texture"),
        log:
            f"{RESULTS}/logs/plot_texture.log",
        benchmark:
            f"{RESULTS}/benchmarks/plot_texture.tsv"
        threads: 1
        resources:
            mem_mb=memory_mb,
            runtime=minutes,
        params:
            note=SOURCE_NOTE,
            code=code("plot_texture.py"),
        message:
            "Drawing the texture of the patches"
        script:
            "../scripts/plot_texture.py"
