# The page that a person opens after a study, and its pictures, from stored results only.
# Takes: HDF5 and tables of every stage, and the tool's mesh. Gives: a PNG of each figure, an SVG of curves
# too, and folders with a PNG for each patch; index.html; a record of all inputs and results. One job draws
# several figures: it takes longer to start than to draw one.

# Nobody must take a figure of a synthetic stone for one of a real tool.
SOURCE_NOTE = "synthetic specimen" if GENERATED else None
# What jobs that draw figures are told: all of them, and those that draw patches.
DRAWN = {
    "size_mm": SQUARE_MM,
    "patch_mm": PATCH_MM,
    "note": SOURCE_NOTE,
    "code": code("draw_figures.py"),
}
OF_PATCHES = {
    "patches": ALL_PATCHES,
    "worn": WORN_PATCHES,
    "max_plotted_patches": config["max_plotted_patches"],
}
# How the tool was used, where that is asked.
OF_USE, USE_PICTURE = {}, {}
if INFERRED:
    OF_USE = {"use": rules.infer_use.output.use, "use_table": rules.infer_use.output.table}
    if WORN_PATCHES:
        OF_USE["surface"] = rules.grid_macroscale.output.face
        OF_USE["predicted_losses"] = rules.infer_use.output.losses
    USE_PICTURE["use_png"] = picture("use", "6 Use", "load point and radius of the active tool")


if SCANNED:

    rule draw_inputs:
        input:
            surface=rules.grid_macroscale.output.face,
        output:
            inputs_png=picture("inputs", "1 Inputs", "square and scanned patches"),
        log:
            f"{RESULTS}/logs/draw_inputs.log",
        resources:
            mem_mb=growing(500),
        params:
            **DRAWN,
            places=PLACES,
        message:
            "Drawing the inputs"
        script:
            "../scripts/draw_figures.py"

    rule draw_contact:
        input:
            **(
                {
                    "others": OTHER_CONTACTS,
                    "reference": rules.solve_reference.output.patches,
                    "two_scales": rules.compare_scales.output.table,
                }
                if REFERENCE
                else {}
            ),
            **({"exposure": EXPOSURE} if EXPOSURE else {}),
            **({"t1": surfaces("T1"), "depths": DEPTHS} if WORN_PATCHES else {}),
            mesh=MESH,
            surface=rules.grid_macroscale.output.face,
            contact=rules.solve_macroscale.output.contact,
            pressures=PRESSURES,
            intervals=rules.bound_pressures.output.table,
            contacts=CONTACTS,
            registered=CHANGES,
        output:
            **(
                {
                    "exposure_png": picture(
                        "exposure", "3 Coupling", "effect of a gesture on the square"
                    )
                }
                if EXPOSURE
                else {}
            ),
            **(
                {"two_scales_png": picture("two_scales", "3 Coupling", "cost of two scales")}
                if REFERENCE
                else {}
            ),
            overview_png=picture("overview", "0 Overview", "the study at a glance"),
            contact_steps_png=picture("contact_steps", "2 Macroscale", "contact as the load grows"),
            forces_png=picture(
                "forces", "3 Coupling", "contact forces and pressures of the patches"
            ),
            microscale_maps_png=picture("microscale_maps", "4 Microscale", "contact of every patch"),
            load_curves_png=picture(
                "load_curves", "4 Microscale", "area and pressure curves at both scales"
            ),
            load_curves_svg=curves("load_curves"),
        log:
            f"{RESULTS}/logs/draw_contact.log",
        resources:
            mem_mb=growing(700, scan=100, mesh=18),
        params:
            **OF_PATCHES,
            **DRAWN,
            force_N=LOAD["force_N"],
            mesh_unit=MESH_UNIT,
        message:
            "Drawing the contact"
        script:
            "../scripts/draw_figures.py"


if WORN_PATCHES:

    rule draw_validation:
        input:
            **OF_USE,
            contacts=CONTACTS,
            t1=surfaces("T1"),
            registered=CHANGES,
            depths=DEPTHS,
            pressures=PRESSURES,
            intervals=rules.bound_pressures.output.table,
            registration=rules.tabulate_changes.output.registration,
            patches_table=rules.score_wear.output.patches,
            summary=rules.score_wear.output.summary,
            wear=rules.score_wear.output.wear,
            wear_profile=rules.score_wear.output.profile,
            texture=rules.tabulate_texture.output.table,
        output:
            **USE_PICTURE,
            validation_png=picture(
                "validation", "5 Validation", "the predicted loss beside its baselines"
            ),
            validation_svg=curves("validation"),
            wear_png=picture(
                "wear", "5 Validation", "how much each patch loses, and at which heights"
            ),
            wear_svg=curves("wear"),
            patch_png=pictures_by_patch("patch", "5 Validation", "each patch before and after use"),
            strip_jpg=directory(f"{RESULTS}/figures/strip"),
            texture_png=picture("texture", "5 Validation", "surface texture before and after use"),
            texture_svg=curves("texture"),
        log:
            f"{RESULTS}/logs/draw_validation.log",
        resources:
            mem_mb=growing(600, scan=120),
        params:
            **OF_PATCHES,
            **DRAWN,
            places=PLACES,
        message:
            "Drawing the validation"
        script:
            "../scripts/draw_figures.py"


if not SCANNED:

    rule draw_places:
        input:
            **OF_USE,
            mesh=MESH,
            surface=rules.grid_macroscale.output.face,
            contact=rules.solve_macroscale.output.contact,
            exposure=EXPOSURE,
            proposed=rules.propose_places.output.table,
        output:
            **USE_PICTURE,
            places_png=picture("places", "0 Overview", "where to scan: a sheet to print"),
            places_pdf=f"{RESULTS}/figures/places.pdf",
            contact_steps_png=picture("contact_steps", "2 Macroscale", "contact as the load grows"),
            exposure_png=picture("exposure", "2 Macroscale", "effect of a gesture on the face"),
        log:
            f"{RESULTS}/logs/draw_places.log",
        resources:
            mem_mb=growing(700, mesh=18),
        params:
            **DRAWN,
            places=GRADED.to_dict("list"),
            mesh_unit=MESH_UNIT,
        message:
            "Drawing the positions to scan"
        script:
            "../scripts/draw_figures.py"


# Captions of the tables and figures on the page and, last, of the numbers behind a figure, which are
# too many for it: `gst package` packs these, too.
LOAD_PATHS = rules.tabulate_microscale.output.paths if SCANNED else []
CAPTIONED = dict(SHOWN)
if SCANNED:
    CAPTIONED[LOAD_PATHS] = (
        "tables/microscale_paths.rst",
        "4 Microscale",
        TABLES["microscale_paths"].title,
    )


# The last job: if its record exists, the study is complete.
rule write_page:
    input:
        mesh=MESH,
        counterface=COUNTERFACE_MESH,
        use=rules.infer_use.output.use if INFERRED else [],
        surface=rules.grid_macroscale.output.face,
        contact=rules.solve_macroscale.output.contact,
        shown=list(SHOWN),
        t0=surfaces("T0") if SCANNED else [],
        t1=surfaces("T1") if WORN_PATCHES else [],
        exposure=EXPOSURE,
        behind=LOAD_PATHS,
        curves=CURVES,
        by_patch=rules.draw_validation.output.patch_png if WORN_PATCHES else [],
        strips=rules.draw_validation.output.strip_jpg if WORN_PATCHES else [],
        made_from=files_read(config, PATCHES),
    output:
        page=f"{RESULTS}/index.html",
        record=f"{RESULTS}/provenance.json",
        contents=f"{RESULTS}/contents.json",
    log:
        f"{RESULTS}/logs/write_page.log",
    resources:
        mem_mb=growing(650, mesh=12),
    params:
        # Of the program, wherever it lies: `program` is the hash of these files, too.
        described=[list(described) for described in CAPTIONED.values()],
        # The study's own, whose records and warnings the page takes, each as this config asks for it;
        # none that other configs left in the folder, or of other studies in the same run.
        steps=hashes_of(steps_of(workflow, Path(RESULTS)), Path(RESULTS)),
        places=(
            columns("patch", "x_mm", "y_mm", "rotation_deg", "t0", "t1")
            if SCANNED
            else GRADED.to_dict("list")
        ),
        mesh_unit=MESH_UNIT,
        active_tool=ACTIVE_TOOL,
        config=config,
        config_faults=CONFIG_FAULTS,
        tables=TABLE_DIGESTS,
        commit=commit(ROOT),
        program=program_hash(),
        code=code("write_page.py"),
    message:
        "Writing the page: {output.page}"
    script:
        "../scripts/write_page.py"
