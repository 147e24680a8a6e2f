"""Where does a ground stone tool wear? Multi-scale elastic contact of measured stone surfaces.

Lengths are in mm, forces in N, pressures and moduli in MPa (= N/mm²), unless a name indicates
otherwise. The method is described by M. R. Marulli, G. Sorrentino and M. Paggi, *Multi-scale
contact mechanics framework for upper palaeolithic ground stone tools*, J. Archaeol. Sci. Rep.
(2024) 104939.

All functions that most users need are here: ``gstlib.read_scan``, ``gstlib.solve_contact``,
``gstlib.Study``. The names and their modules are in ``__init__.pyi``.
"""

import lazy_loader

__version__ = "0.1.0"

# A job of the workflow is a fresh interpreter, which should not load packages that it never uses.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
