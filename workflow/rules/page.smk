# The page that a person opens after a study.
# Takes: every figure and table of the study, and the tool with the pressure on its square. Gives:
# index.html, and the answer alone for the report; a record of all inputs and results.


# The study's own steps, whose records and warnings the page takes; none that other configs left in
# the folder, or of other studies in the same run.
STEPS = [step.name for step in steps_of(workflow, Path(RESULTS))]
# Captions of the tables and figures on the page and, last, of the numbers behind a figure, which are
# too many for it: `gst package` packs these, too.
LOAD_PATHS = f"{RESULTS}/tables/microscale_paths.csv"
CAPTIONED = dict(SHOWN)
if SCANNED:
    CAPTIONED[LOAD_PATHS] = (
        f"{CAPTIONS}/tables/microscale_paths.rst",
        "4 Microscale",
        TABLES["microscale_paths"].title,
    )


# The last job: if its record exists, the study is complete.
rule write_page:
    input:
        mesh=MESH,
        counterface=COUNTERFACE_MESH,
        surface=f"{RESULTS}/macroscale/surface.h5",
        contact=CONTACT,
        shown=list(SHOWN),
        exposure=f"{RESULTS}/gesture/exposure.h5" if POSES is not None else [],
        behind=LOAD_PATHS if SCANNED else [],
        captions=[caption for caption, _, _ in CAPTIONED.values()],
        by_patch=f"{RESULTS}/figures/patch" if WORN_PATCHES else [],
        made_from=[*filter(None, [config["patches"], config["published"]])]
        + [
            (config["counterface"] or {}).get("mesh", []),
            (config["gesture"] or {}).get("table", []),
        ]
        + ([COUNTERFACE_SCAN] if GENERATED else [MESH, *SCANS]),
    output:
        page=f"{RESULTS}/index.html",
        report=f"{RESULTS}/verdict.html",
        record=f"{RESULTS}/provenance.json",
        contents=f"{RESULTS}/contents.json",
    log:
        f"{RESULTS}/logs/write_page.log",
    params:
        titles=[[category, title] for _, category, title in CAPTIONED.values()],
        steps=STEPS,
        places=PLACES,
        patch_mm=PATCH_MM,
        mesh_unit=MESH_UNIT,
        second_stone=SECOND_STONE,
        config=config,
        commit=commit(ROOT),
        program=program_hash(),
        code=code("write_page.py"),
    message:
        "Writing the page: {output.page}"
    script:
        "../scripts/write_page.py"
