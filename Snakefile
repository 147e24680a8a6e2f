"""Where does a ground stone tool wear? From a mesh and confocal scans to predicted and scored wear."""

from snakemake.utils import min_version

min_version("9.14.8")


# Where no other config is given. What a config leaves out has the default of the schema.
if not workflow.configfiles:

    configfile: "config/config.yaml"


report: "workflow/report/study.rst"


include: "workflow/rules/common.smk"
include: "workflow/rules/specimen.smk"
include: "workflow/rules/macroscale.smk"
include: "workflow/rules/gesture.smk"


if SCANNED:

    include: "workflow/rules/coupling.smk"
    include: "workflow/rules/microscale.smk"
    include: "workflow/rules/validation.smk"

else:

    include: "workflow/rules/places.smk"


include: "workflow/rules/figures.smk"
include: "workflow/rules/page.smk"


# All that the rules make, so that whatever is deleted is made again.
MADE = [
    str(file)
    for one in workflow.rules
    for file in one.output
    if "{" not in file and file.startswith(f"{RESULTS}/")
]


rule all:
    default_target: True
    input:
        MADE,


# What a step would be given now decides whether it runs again, and not dates. Snakemake without
# `gst study` has to be told.
if workflow.is_main_process:
    AGAIN.update(plan_again(steps_of(workflow, Path(RESULTS)), Path(RESULTS)))
    if AGAIN and "gst.scheduler" not in sys.orig_argv:
        logger.warning(f"To make again what has changed, add: --forcerun {' '.join(AGAIN)}")
