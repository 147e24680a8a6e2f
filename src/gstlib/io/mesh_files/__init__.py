"""What a mesh file says of itself, held against what is in it, before trimesh reads it.

trimesh reads on past much of what is wrong with a file, and what comes out is a part of the stone,
or another one. Here a file is walked through once; what concerns its shape is handed on, alone:
names, colours and materials are left behind, so that no other file is ever opened.

References: the STL, PLY and OBJ pages of the Library of Congress, Sustainability of Digital
Formats, and the format descriptions linked there.
"""

from collections.abc import Callable
from pathlib import Path

from gstlib.io.mesh_files.obj import obj_vertices, plain_obj
from gstlib.io.mesh_files.plain import PlainMesh
from gstlib.io.mesh_files.ply import plain_ply, ply_vertices
from gstlib.io.mesh_files.stl import plain_stl

__all__ = ["PLAIN", "PlainMesh", "obj_vertices", "ply_vertices"]

# By suffix: a function of the file's path (for messages) and its bytes.
PLAIN: dict[str, Callable[[Path, bytes], PlainMesh]] = {
    "stl": plain_stl,
    "ply": plain_ply,
    "obj": plain_obj,
}
