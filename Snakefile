"""Where does a ground stone tool wear? From a mesh and confocal scans to predicted and scored wear."""

import os
import sys

# Snakemake puts the folder of a Snakefile first on Python's path. It may be that of a study, too,
# whose files are no modules.
if sys.path[0] == os.getcwd():
    del sys.path[0]

from snakemake.utils import min_version

min_version("9.14.8")


# Where no other config is given. What a config leaves out has the default of the schema.
if not workflow.configfiles:

    configfile: "config/config.yaml"


report: "workflow/report/study.rst"


include: "workflow/rules/common.smk"
include: "workflow/rules/specimen.smk"
include: "workflow/rules/preprocess.smk"
include: "workflow/rules/macroscale.smk"


if SCANNED:

    include: "workflow/rules/coupling.smk"
    include: "workflow/rules/microscale.smk"
    include: "workflow/rules/change.smk"


if INFERRED:

    include: "workflow/rules/use.smk"


if WORN_PATCHES:

    include: "workflow/rules/wear.smk"


if SCANNED:

    include: "workflow/rules/validation.smk"


include: "workflow/rules/page.smk"


STEPS = steps_of(workflow, Path(RESULTS))


rule all:
    default_target: True
    input:
        # all that is made, so that whatever is deleted is made again
        [str(file) for step in STEPS for file in step.outputs],


# What a step would be given now decides whether it runs again, and not dates. Snakemake without
# `gst study` has to be told.
if workflow.is_main_process:
    refuse_foreign(STEPS, Path(RESULTS))
adapt(workflow, STEPS, Path(RESULTS), config["accept"])
if AGAIN and workflow.is_main_process and "gst.run.scheduler" not in sys.orig_argv:
    logger.warning(f"To make again what has changed, add: --forcerun {' '.join(AGAIN)}")


onstart:
    claim(written_by(STEPS, Path(RESULTS)), Path(RESULTS))
    move_aside(workflow.dag.needrun_jobs(), Path(RESULTS), ALL_PATCHES)
