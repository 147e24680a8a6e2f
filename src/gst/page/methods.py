"""The methods paragraph of a study for a paper, with settings, versions and citations.

The sentences are in ``methods.jinja`` beside this module.
"""

import re
from collections.abc import Container, Mapping
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd

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
    config = provenance["config"]
    source = Path(__file__).with_suffix(".jinja").read_text("utf-8")
    template = jinja2.Template(source, undefined=jinja2.StrictUndefined)
    text = template.render(
        provenance,
        tables=tables,
        load=_adopted(use),
        force_N=load_force(config["load"], config["square"]["size_mm"]),
        modulus_MPa=study_modulus(config["material"]),
    )
    whole = (" ".join(paragraph.split()) for paragraph in text.split("¶"))
    # no space before the mark that ends a sentence
    return re.sub(" (?=[.,])", "", "\n\n".join(filter(None, whole)) + "\n")


def _adopted(use: pd.DataFrame | None) -> dict[str, float] | None:
    """Means of the adopted load case by parameter; None if the study keeps the given load."""
    if use is None or not use.adopted.any():
        return None
    means: dict[str, float] = (
        use.set_index("parameter").posterior_mean.dropna().to_dict()
    )
    return means
