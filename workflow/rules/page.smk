# The page that a person opens after a study.
# Takes: every figure and table of the study, and the tool with the pressure on its square. Gives:
# index.html, and the answer alone for the report; last, a record of all inputs and results.


# Logs of the study's own steps, for their warnings. Logs that other configs left in the folder, or
# of other studies in the same run, are not read.
LOGS = [
    str(log)
    for one in workflow.rules
    for log in one.log
    if "{" not in log and log.startswith(f"{RESULTS}/")
]
# Without the sweep, which runs only on request.
STUDIED = {file: place for file, place in SHOWN.items() if place[1] < "9"}
# What `gst package` packs: also the numbers behind a figure, which are too many for the page.
LOAD_PATHS = (
    f"{CAPTIONS}/tables/microscale_paths.rst",
    "4 Microscale",
    TABLES["microscale_paths"].title,
)
PACKED = STUDIED | {f"{RESULTS}/tables/microscale_paths.csv": LOAD_PATHS}
# Keys that captions quote: only a change to one of these makes the page anew.
QUOTED = "counterface coupling gesture grinding hardness macroscale mat material specimen square texture title uncertainty validation"


rule write_page:
    input:
        mesh=MESH,
        counterface=COUNTERFACE_MESH,
        surface=f"{RESULTS}/macroscale/surface.h5",
        contact=CONTACT,
        shown=list(STUDIED),
        captions=[caption for caption, _, _ in STUDIED.values()],
        by_patch=f"{RESULTS}/figures/patch" if WORN_PATCHES else [],
    output:
        page=f"{RESULTS}/index.html",
        report=f"{RESULTS}/verdict.html",
    log:
        f"{RESULTS}/logs/write_page.log",
    params:
        titles=[[category, title] for _, category, title in STUDIED.values()],
        logs=LOGS,
        places=PATCHES[["patch", "x_mm", "y_mm", "rotation_deg"]].to_dict("list"),
        patch_mm=PATCH_MM,
        mesh_unit=MESH_UNIT,
        second_stone=SECOND_STONE,
        config={section: config[section] for section in QUOTED.split()},
        code=code("write_page.py"),
    message:
        "Writing the page: {output.page}"
    script:
        "../scripts/write_page.py"


# The last job: if this record exists, the study is complete.
rule record_provenance:
    input:
        files=[config["patches"], *filter(None, [config["published"]])]
        + [
            (config["counterface"] or {}).get("mesh", []),
            (config["gesture"] or {}).get("table", []),
        ]
        + ([COUNTERFACE_SCAN] if GENERATED else [MESH, *SCANS]),
        page=rules.write_page.output.page,
        packed=list(PACKED),
        captions=[caption for caption, _, _ in PACKED.values()],
    output:
        record=f"{RESULTS}/provenance.json",
        contents=f"{RESULTS}/contents.json",
    log:
        f"{RESULTS}/logs/record_provenance.log",
    params:
        titles=[[category, title] for _, category, title in PACKED.values()],
        config=config,
        commit=commit(ROOT),
        program=program_hash(),
        code=code("record_provenance.py"),
    message:
        "Recording where the results come from"
    script:
        "../scripts/record_provenance.py"
