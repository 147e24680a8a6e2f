# Every file read once before any work, so that all that is wrong with them is said at once.
# Takes: the mesh and every scan. Gives: what they hold, and a picture of where the patches lie.
# No rule takes its output, which would make all of them rerun with it: it goes first by its priority,
# and alone, for it asks for more cores than there are; if it fails, nothing else is begun.


rule check_inputs:
    input:
        mesh=MESH,
        scans=sorted({file for file, _ in SCAN_USES}),
        marker=[] if MARKER is None else MARKER,
    output:
        table=report(
            f"{RESULTS}/tables/inputs.csv",
            caption="../report/inputs_table.rst",
            category="1 Inputs",
            labels={"what": "table: what every scan holds"},
        ),
        inputs=picture("inputs", "1 Inputs", "square and scanned patches"),
        inputs_svg=vector("inputs"),
    log:
        f"{RESULTS}/logs/check_inputs.log",
    benchmark:
        f"{RESULTS}/benchmarks/check_inputs.tsv"
    priority: 100
    threads: 64
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        uses=SCAN_USES,
        patches=PATCHES.to_dict("list"),
        mesh_unit="mm" if GENERATED else config["inputs"]["mesh_unit"],
        square=config["square"],
        macroscale={name: config["macroscale"][name] for name in ("grid", "margin_mm")},
        scans=config["scans"],
        maximum_unmeasured=config["preprocessing"]["maximum_unmeasured"],
        note=SOURCE_NOTE,
        code=code("check_inputs.py"),
    message:
        "Looking at every file of the study"
    script:
        "../scripts/check_inputs.py"


rule record_provenance:
    input:
        [config["patches"]]
        + [file for file in (config["published"], MARKER) if file is not None]
        + ([] if GENERATED else [MESH, *sorted({file for file, _ in SCAN_USES})]),
    output:
        record=f"{RESULTS}/provenance.json",
    log:
        f"{RESULTS}/logs/record_provenance.log",
    threads: 1
    resources:
        mem_mb=memory_mb,
        runtime=minutes,
    params:
        config=config,
        commit=commit(workflow.basedir),
        code=code("record_provenance.py"),
    message:
        "Recording where the results come from"
    script:
        "../scripts/record_provenance.py"
