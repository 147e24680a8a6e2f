"""How often does the study find a relation that is there, and how often one that is not?

The generated specimen answers, since there it is known: many are made, each once with wear on its
summits and once with the same wear moved elsewhere by chance, and each goes through the study.
"""

from gstlib.power.claims import p_values
from gstlib.power.rates import LEVELS, rejection_rates
from gstlib.power.trial import Trial, try_specimen

__all__ = ["LEVELS", "Trial", "p_values", "rejection_rates", "try_specimen"]
