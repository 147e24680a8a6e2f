"""Two faces in, a contact out: at one load, or along the path to it.

`gstlib.bem` computes with arrays. This package uses the study's surfaces, with names and units, and
explains the solver's errors. An `Interface` under a `Load` gives a `Contact`, or a `ContactPath`.
If the pressure is zero, the contact is empty: its pressure, displacement and stiffness are 0, and
shares of the contact are NaN.
"""

from .interface import Interface, Load, check_grid, turned_over
from .solve import contact_at_pressure, contact_path, solve_again
from .state import VARIABLES, Contact, ContactPath, load_path_table

__all__ = [
    "VARIABLES",
    "Contact",
    "ContactPath",
    "Interface",
    "Load",
    "check_grid",
    "contact_at_pressure",
    "contact_path",
    "load_path_table",
    "solve_again",
    "turned_over",
]
