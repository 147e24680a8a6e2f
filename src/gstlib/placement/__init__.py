"""Does each patch lie where the patch table says?

The mesh and a scan show the same stone, so the waves that both hold must agree wherever the patch
truly lies. Those waves are few: longer than the mesh's points hold, √3 edges of its triangles, and
not much longer than the patch, which has lost its plane. Both surfaces are therefore written as
the same set of waves over the patch's footprint, level (`waves`); their correlation is mapped over
trial shifts of the footprint on the square, and far from it (`matching`). Its peak is the likeliest
place. How likely a peak as high is by chance is read off the same map far from the nominal place;
how well the peak is placed follows from its curvature and from what both surfaces disagree by, over
all patches (`peaks`). All patches together tell of a shift that they share, and of a wrong mould
(`together`).
"""

from gstlib.placement.rows import AGREES, ALL, CANNOT_TELL, SHIFTED
from gstlib.placement.table import found_places, place_patches, warnings_of

__all__ = [
    "AGREES",
    "ALL",
    "CANNOT_TELL",
    "SHIFTED",
    "found_places",
    "place_patches",
    "warnings_of",
]
