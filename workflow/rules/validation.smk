# Was the prediction right?
# Takes: results of earlier stages. Gives: how well the predicted loss agrees with the measured one,
# beside baselines that are given the same data; the contact of the patches beside one contact of the whole square at
# their resolution, and beside published figures; of a synthetic specimen every stage beside the truth.


if WORN_PATCHES:

    rule score_wear:
        input:
            contacts=expand(rules.solve_patches.output.contacts, batch=WORN_BATCHES),
            registered=CHANGES,
            square=rules.fit_wear.output.square,
            fitted=INTERLAYER,
            depths=DEPTHS,
            pressures=PRESSURES,
            registration=rules.tabulate_changes.output.registration,
            use=inferred_use,
        output:
            laws=table("laws", "5 Validation"),
            patches=table("validation_patches", "5 Validation"),
            wear=table("wear", "5 Validation"),
            profile=table("wear_profile", "5 Validation"),
            summary=table("validation_summary", "5 Validation"),
        log:
            f"{RESULTS}/logs/score_wear.log",
        resources:
            mem_mb=growing(500, scan=100, scans=12),
            runtime=growing(10, scans=0.5),
        params:
            scoring=SETTINGS["score_wear"],
            worn=WORN_PATCHES,
            code=code("score_wear.py"),
        message:
            "Scoring the predicted loss"
        script:
            "../scripts/score_wear.py"


if REFERENCE:

    rule solve_reference:
        input:
            face=rules.grid_macroscale.output.face,
            composite=COMPOSITE,
            macroscale=rules.solve_macroscale.output.contact,
            t0=surfaces("T0"),
            true_surface=rules.generate_specimen.output.surface if GENERATED else [],
            truth=rules.generate_specimen.output.truth if GENERATED else [],
        output:
            contact=f"{RESULTS}/reference/contact.h5",
            patches=f"{RESULTS}/reference/patches.h5",
        log:
            f"{RESULTS}/logs/solve_reference.log",
        resources:
            mem_mb=growing(700, square=45),
            runtime=growing(10, square=0.5 * config["reference_realisations"]),
        params:
            drawn={
                "draws": config["reference_realisations"],
                "s_filter_um": config["microscale"]["s_filter_um"],
                "seed": config["seed"],
            },
            code=code("solve_reference.py"),
        message:
            "Pressing the whole square at the scans' resolution"
        script:
            "../scripts/solve_reference.py"

    rule compare_scales:
        input:
            reference=rules.solve_reference.output.patches,
            contacts=CONTACTS,
            others=OTHER_CONTACTS,
        output:
            table=table("two_scales", "3 Coupling"),
        log:
            f"{RESULTS}/logs/compare_scales.log",
        resources:
            mem_mb=growing(500, scan=60),
        params:
            patches=ALL_PATCHES,
            variants=VARIANTS,
            code=code("compare_scales.py"),
        message:
            "Comparing the patches with the contact of the whole square"
        script:
            "../scripts/compare_scales.py"


if config["published"] is not None:

    rule compare_published:
        input:
            published=config["published"],
            path=rules.solve_macroscale.output.path,
            pressures=rules.couple_scales.output.pressures,
        output:
            table=table("published", "3 Coupling"),
        log:
            f"{RESULTS}/logs/compare_published.log",
        params:
            code=code("compare_published.py"),
        message:
            "Comparing computed with published values"
        script:
            "../scripts/compare_published.py"


if GENERATED:

    rule score_truth:
        input:
            truth=rules.generate_specimen.output.truth,
            surface=rules.grid_macroscale.output.face,
            placement=rules.check_placement.output.table,
            pressures=PRESSURES,
            t0=surfaces("T0"),
            t1=surfaces("T1"),
            registered=CHANGES,
            two_scales=rules.compare_scales.output.table if REFERENCE else [],
            use=rules.infer_use.output.table if INFERRED else [],
        output:
            table=table("truth", "7 Against the truth"),
        log:
            f"{RESULTS}/logs/score_truth.log",
        resources:
            mem_mb=growing(500, scan=160),
            runtime=growing(10, scans=0.2),
        params:
            patches=ALL_PATCHES,
            code=code("score_truth.py"),
        message:
            "Scoring every stage against the specimen's truth"
        script:
            "../scripts/score_truth.py"
