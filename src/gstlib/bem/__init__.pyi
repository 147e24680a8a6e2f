# What users need of the solver; `__init__.py` reads this file.
from .errors import ContactError as ContactError
from .errors import ContactInputError as ContactInputError
from .errors import ContactWarning as ContactWarning
from .errors import ConvergenceError as ConvergenceError
from .errors import TippingError as TippingError
from .halfspace import HalfSpace as HalfSpace
from .halfspace import contact_modulus as contact_modulus
from .layer import Layer as Layer
from .loading import LoadPath as LoadPath
from .loading import load_path as load_path
from .solver import solve_contact as solve_contact
from .state import ContactState as ContactState
from .wear import ThirdBody as ThirdBody
from .wear import WearPath as WearPath
from .wear import wear_path as wear_path
