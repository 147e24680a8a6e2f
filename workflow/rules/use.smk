# How the tool was used.
# Takes: the stone with its scans laid on it, and what its patches lost; or the mesh alone, and grades of
# wear by eye. Gives: where it was pressed, and against how round a tool, as the wear says; every contact
# after this one is under that use.


rule infer_use:
    input:
        face=PRESSED_FACE,
        registration=rules.tabulate_changes.output.registration if WORN_PATCHES else [],
    output:
        **({"losses": table("predicted_losses", "6 Use")} if WORN_PATCHES else {}),
        use=f"{RESULTS}/use/use.h5",
        table=table("use", "6 Use"),
    log:
        f"{RESULTS}/logs/infer_use.log",
    resources:
        runtime=growing(30, scans=0.1),
    params:
        settings=SETTINGS["infer_use"],
        patches=PLACES if SCANNED else GRADED.to_dict("list"),
        code=code("infer_use.py"),
    message:
        "Inferring the load case from the wear"
    script:
        "../scripts/infer_use.py"
