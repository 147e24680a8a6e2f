# The page that a person opens after a study.
# Takes: every figure and table of the study, and the tool with the pressure on its square. Gives: index.html, and the
# answer alone for the report.


# Logs of the study's own steps, for their warnings: what other configs left in the folder is not read.
LOGS = [str(log) for one in workflow.rules for log in one.log if "{" not in log]
# Not the power and the sweep, which are asked for by themselves.
STUDIED = {file: place for file, place in SHOWN.items() if place[1] < "8"}
# What captions quote: another key's change leaves the page as it is.
QUOTED = "counterface coupling gesture grinding hardness macroscale material specimen square texture title uncertainty validation"


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
    benchmark:
        f"{RESULTS}/benchmarks/write_page.tsv"
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
