# Where to scan, before anything is scanned: a study without patches.
# Takes: the contact of the face, and the exposure that the poses of a gesture leave. Gives: the places with the
# most exposure, and some that nothing touches; the tool with both fields for other programs.


rule propose_places:
    input:
        exposure=f"{RESULTS}/gesture/exposure.h5",
    output:
        table=table("places", "0 Overview"),
    log:
        f"{RESULTS}/logs/propose_places.log",
    params:
        size_mm=SQUARE_MM,
        patch_mm=PATCH_MM,
        code=code("propose_places.py"),
    message:
        "Looking for places to scan"
    script:
        "../scripts/propose_places.py"


rule colour_tool:
    input:
        mesh=MESH,
        face=FACE,
        contact=f"{RESULTS}/macroscale/contact.h5",
        exposure=f"{RESULTS}/gesture/exposure.h5",
    output:
        tool=f"{RESULTS}/tool.ply",
    log:
        f"{RESULTS}/logs/colour_tool.log",
    params:
        mesh_unit=MESH_UNIT,
        code=code("colour_tool.py"),
    message:
        "Laying pressure and exposure on the tool: {output.tool}"
    script:
        "../scripts/colour_tool.py"
