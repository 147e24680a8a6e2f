"""The methods paragraph of a study for a paper, with settings, versions and citations.

The sentences are in ``methods.jinja`` beside this module.
"""

from collections.abc import Container, Mapping
from typing import Any

import pandas as pd

from gst.page.templates import paragraphs, render
from gstlib.conditions import load_force, study_modulus


def methods_text(
    provenance: Mapping[str, Any],
    tables: Container[str],
    use: pd.DataFrame | None = None,
) -> str:
    """The methods of a study, and the references.

    `provenance` is as from `gst.run.provenance.study_provenance`, and `tables` are the names of the
    tables that the study has. `use` is the table of this name, if there is one. Raises a
    `jinja2.TemplateError` or a `LookupError` if a part of the provenance is missing.
    """
    config, load = provenance["config"], {}
    if use is not None and use.adopted.any():
        load = use.set_index("parameter").posterior_mean.dropna().to_dict()
    text = render(
        "methods.jinja",
        **provenance,
        tables=tables,
        load=load,
        force_N=load_force(config["load"], config["square"]["size_mm"]),
        modulus_MPa=study_modulus(config["material"]),
    )
    return "\n\n".join(paragraphs(text)) + "\n"
