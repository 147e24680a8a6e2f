# Pictures, from stored results only.
# Takes: HDF5 and tables of every stage. Gives: a PNG of each figure, an SVG of curves too, and
# folders with a PNG for each patch. One job draws several figures: starting a job takes longer than
# drawing one.

# Nobody must take a figure of a generated stone for one of a real tool.
SOURCE_NOTE = "generated specimen" if GENERATED else None
# One picture per patch, in a folder.
BY_PATCH = ("preparation", "patch")
VECTOR = dict.fromkeys(("load_curves", "validation", "texture", "wear"), "svg")
VECTOR["places"] = "pdf"  # to be printed

CONTACT = f"{RESULTS}/macroscale/contact.h5"
PRESSURES = f"{RESULTS}/tables/patch_pressures.csv"
# By job: the category and title of each figure that it draws, and the files that it reads.
DRAWINGS = {
    "draw_inputs": (
        {
            "inputs": ("1 Inputs", "square and scanned patches"),
            "preparation": ("1 Inputs", "preparation of the scans"),
        },
        {
            "surface": f"{RESULTS}/macroscale/surface.h5",
            "t0": surfaces("T0", ALL_PATCHES),
            "t1": surfaces("T1", WORN_PATCHES),
        },
    ),
    "draw_contact": (
        {
            "overview": ("0 Overview", "the study at a glance"),
            "contact_steps": ("2 Macroscale", "contact as the load grows"),
            "forces": ("3 Coupling", "contact forces and pressures of the patches"),
            "microscale_maps": ("4 Microscale", "contact of every patch"),
            "load_curves": ("4 Microscale", "area and pressure curves at both scales"),
        },
        {
            "mesh": MESH,
            "surface": f"{RESULTS}/macroscale/surface.h5",
            "contact": CONTACT,
            "pressures": PRESSURES,
            "intervals": f"{RESULTS}/tables/patch_intervals.csv",
            "contacts": contacts(ALL_PATCHES),
            "registered": registered(WORN_PATCHES),
        },
    ),
}
if not SCANNED:
    DRAWINGS = {
        "draw_contact": (
            {
                "places": ("0 Overview", "where to scan: a sheet to print"),
                "contact_steps": ("2 Macroscale", "contact as the load grows"),
            },
            {
                "mesh": MESH,
                "surface": f"{RESULTS}/macroscale/surface.h5",
                "contact": CONTACT,
                "proposed": f"{RESULTS}/tables/places.csv",
            },
        )
    }
if POSES is not None:
    figures, read = DRAWINGS["draw_contact"]
    figures["exposure"] = (
        "3 Coupling" if SCANNED else "2 Macroscale",
        f"what a gesture leaves on the {'square' if SCANNED else 'face'}",
    )
    read["exposure"] = f"{RESULTS}/gesture/exposure.h5"
if REFERENCE:
    figures, read = DRAWINGS["draw_contact"]
    figures["two_scales"] = ("3 Coupling", "what two scales cost")
    read |= {
        "others": other_contacts(ALL_PATCHES),
        "reference": f"{RESULTS}/reference/patches.h5",
        "two_scales": f"{RESULTS}/tables/two_scales.csv",
    }
if WORN_PATCHES:
    DRAWINGS["draw_contact"][1]["worn_patches"] = f"{RESULTS}/wear"
    DRAWINGS["draw_validation"] = (
        {
            "validation": ("5 Validation", "the predicted loss beside its rivals"),
            "wear": ("5 Validation", "how much each patch loses, and at which heights"),
            "patch": ("5 Validation", "each patch before and after use"),
            "texture": ("5 Validation", "surface texture before and after use"),
        },
        {
            "contacts": contacts(ALL_PATCHES),
            "t1": surfaces("T1", WORN_PATCHES),
            "registered": registered(WORN_PATCHES),
            "worn_patches": f"{RESULTS}/wear",
            "pressures": PRESSURES,
            "intervals": f"{RESULTS}/tables/patch_intervals.csv",
            "registration": f"{RESULTS}/tables/registration.csv",
            "patches_table": f"{RESULTS}/tables/validation_patches.csv",
            "summary": f"{RESULTS}/tables/validation_summary.csv",
            "wear": f"{RESULTS}/tables/wear.csv",
            "wear_profile": f"{RESULTS}/tables/wear_profile.csv",
            "texture": f"{RESULTS}/tables/texture.csv",
        },
    )


def picture(name, category, title):
    """The PNG of a figure, or the folder with one PNG per patch, with its place in the report."""
    place = {"caption": f"../report/{name}.rst", "category": category}
    # Kind and content share one label. From a second label with two values, Snakemake's report
    # would make a switch, and fail where a content does not have both kinds.
    if name not in BY_PATCH:
        file = f"{RESULTS}/figures/{name}.png"
        SHOWN[file] = str(CAPTIONS / f"{name}.rst"), category, title
        return report(file, labels={"what": f"figure: {title}"}, **place)

    def labels(wildcards):
        # The report sorts texts, and 10 before 2; a page does not show spaces in front.
        longest = max(map(len, ALL_PATCHES))
        return {"what": f"figure: {title}", "patch": wildcards.patch.rjust(longest)}

    folder = directory(f"{RESULTS}/figures/{name}")
    return report(folder, patterns=["{patch}.png"], labels=labels, **place)


for job, (figures, read) in DRAWINGS.items():

    rule:
        name:
            job
        input:
            **read,
        output:
            **{f"{name}_png": picture(name, *place) for name, place in figures.items()},
            **{
                f"{name}_{VECTOR[name]}": f"{RESULTS}/figures/{name}.{VECTOR[name]}"
                for name in figures
                if name in VECTOR
            },
        log:
            f"{RESULTS}/logs/{job}.log",
        params:
            figures=list(figures),
            patches=ALL_PATCHES,
            worn=WORN_PATCHES,
            places=PLACES,
            size_mm=SQUARE_MM,
            force_N=LOAD["force_N"],
            patch_mm=PATCH_MM,
            mesh_unit=MESH_UNIT,
            most_drawn_patches=config["most_drawn_patches"],
            note=SOURCE_NOTE,
            code=code("draw_figures.py"),
        message:
            f"Drawing: {', '.join(figures)}"
        script:
            "../scripts/draw_figures.py"
