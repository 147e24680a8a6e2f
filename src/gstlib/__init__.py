"""Where does a ground stone tool wear? Multi-scale elastic contact of measured stone surfaces.

Lengths are in mm, forces in N, pressures and moduli in MPa (= N/mm²), unless a name says otherwise.
The method is that of M. R. Marulli, G. Sorrentino and M. Paggi, *Multi-scale contact mechanics
framework for upper palaeolithic ground stone tools*, J. Archaeol. Sci. Rep. (2024) 104939.
"""

__all__ = ["__version__"]
__version__ = "0.1.0"
