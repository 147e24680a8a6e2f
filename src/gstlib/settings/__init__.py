"""The settings of a study: every key of its config, typed and checked.

`Settings` is the only source of the keys, their types, bounds, defaults and meanings. The schema of
a config (`json_schema`), the defaults and config/README.md are derived from it.
"""

from gstlib.settings.sections import Settings, json_schema

__all__ = ["Settings", "json_schema"]
