"""Where does a ground stone tool wear? Multi-scale elastic contact of measured stone surfaces.

Lengths are in mm, forces in N, pressures and moduli in MPa (= N/mm²), unless a name says otherwise.
The method is that of M. R. Marulli, G. Sorrentino and M. Paggi, *Multi-scale contact mechanics
framework for upper palaeolithic ground stone tools*, J. Archaeol. Sci. Rep. (2024) 104939.

What a user needs is here: ``gstlib.read_scan``, ``gstlib.solve_contact``, ``gstlib.Study``. The
names, and the room of each, are in ``__init__.pyi``.
"""

import lazy_loader

__version__ = "0.1.0"

# a job of the workflow is a fresh interpreter, which should not load rooms that it never uses
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
