# What wear the contact predicts.
# Takes: the contact of the stone and of its patches, and the height changes. Gives: the square as it
# wears by Archard's law, fitted to the losses; and the loss of each patch that the other patches predict.


rule fit_wear:
    input:
        contact=rules.solve_macroscale.output.contact,
        second=SECOND if POSES is not None else [],
        contacts=CONTACTS if config["interlayer"] else [],
        registered=CHANGES if config["interlayer"] else [],
        pressures=PRESSURES,
        registration=rules.tabulate_changes.output.registration,
    output:
        **({"fitted": f"{RESULTS}/wear/interlayer.h5"} if config["interlayer"] else {}),
        square=f"{RESULTS}/wear/square.h5",
    log:
        f"{RESULTS}/logs/fit_wear.log",
    resources:
        mem_mb=growing(600, scan=600 if config["interlayer"] else 0),
        runtime=growing(30, scans=1 if config["interlayer"] else 0),
    params:
        wear=SETTINGS["fit_wear"],
        patches=WORN_PATCHES,
        poses=None if POSES is None else POSES.to_dict("list"),
        size_mm=SQUARE_MM,
        code=code("fit_wear.py"),
    message:
        "Wearing the square, and fitting its wear to the losses"
    script:
        "../scripts/fit_wear.py"


INTERLAYER = rules.fit_wear.output.fitted if config["interlayer"] else []


rule predict_wear:
    input:
        square=rules.fit_wear.output.square,
        fitted=INTERLAYER,
        contacts=rules.solve_patches.output.contacts,
    output:
        depths=directory(f"{RESULTS}/wear/{{batch}}"),
    log:
        f"{RESULTS}/logs/predict_wear_{{batch}}.log",
    resources:
        mem_mb=growing(500, scan=700),
        runtime=growing(10, batch=2),
    params:
        **SETTINGS["predict_wear"],
        patches=lambda wildcards: WORN_BATCHES[wildcards.batch],
        code=code("predict_wear.py"),
    message:
        f"Wearing the patches: part {{wildcards.batch}} of {len(BATCHES)}"
    script:
        "../scripts/predict_wear.py"


DEPTHS = expand(rules.predict_wear.output.depths, batch=WORN_BATCHES)
