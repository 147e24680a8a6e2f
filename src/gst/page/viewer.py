"""A stone that can be turned in a web page: scripts and data, without network requests.

`viewer.js`, beside this file, draws the stone; its head describes its interface. A page contains
`three_js` and `viewer.js` as inline scripts, and `stone_data` as JSON. three.js is the copy that
trimesh ships for its own viewer.
"""

import base64
import importlib.resources
import io
import zipfile
from typing import TYPE_CHECKING, Any

import numpy as np

from gstlib.errors import InputError

if TYPE_CHECKING:
    import trimesh

# trimesh's page has one script: three.js, its controls and loaders, then trimesh's own code.
_TEMPLATE = "resources/templates/viewer.zip"
_BEGIN, _END = "<script>", "var camera,controls,scene"


def three_js() -> str:
    """three.js (MIT licence), which defines THREE.

    Raises an `InputError` if the installed trimesh ships it in another form.
    """
    template = importlib.resources.files("trimesh") / _TEMPLATE
    try:
        with zipfile.ZipFile(io.BytesIO(template.read_bytes())) as archive:
            page = archive.read("viewer.html.template").decode()
        return page[page.index(_BEGIN) + len(_BEGIN) : page.index(_END)]
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(
            str(template),
            "does not contain three.js where gst looks for it",
            "Install the version of trimesh given in requirements.lock.",
        ) from error


def shipped(name: str, room: str = "gst.page") -> str:
    """A page, script or style that lies in a room of the application."""
    return (importlib.resources.files(room) / name).read_text(encoding="utf-8")


def coarsen(
    mesh: "trimesh.Trimesh", *, faces: int = 120_000, keep: np.ndarray | None = None
) -> "trimesh.Trimesh":
    """A mesh with fewer faces: the vertices in each cell of a grid become their mean.

    A mesh with no more than `faces` faces is returned as it is; each takes about 24 bytes in a
    page. The vertices that `keep` (n,) marks stay as they are. After Rossignac & Borrel (1993),
    Multi-resolution 3D approximations for rendering complex scenes, in Modeling in Computer
    Graphics, Springer, 455-465.
    """
    import trimesh
    from trimesh.grouping import unique_rows

    triangles = np.asarray(mesh.faces)
    if len(triangles) <= faces:
        return mesh
    is_kept = np.zeros(len(mesh.vertices), bool) if keep is None else keep
    # A kept vertex has its own cell.
    own = np.where(is_kept, np.arange(1, len(is_kept) + 1), 0)
    is_full = is_kept[triangles].all(axis=1).sum() > faces / 2
    side = np.sqrt(2 * mesh.area / faces)
    while True:
        cells = np.floor((mesh.vertices - mesh.bounds[0]) / side).astype(np.int64)
        _, cluster = unique_rows(np.column_stack([cells, own]))
        corners = np.sort(cluster[triangles], axis=1)
        whole = (np.diff(corners, axis=1) > 0).all(axis=1)
        first, _ = unique_rows(corners[whole])
        if len(first) <= faces or is_full:
            break
        side *= 1.02 * np.sqrt(len(first) / faces)
    sums = [np.bincount(cluster, coordinate) for coordinate in mesh.vertices.T]
    means = np.transpose(sums / np.bincount(cluster))
    left = triangles[whole][np.sort(first)]
    coarse = trimesh.Trimesh(means, cluster[left], process=False)
    # Where a cell contains a fold, a face may have been turned over, and would be drawn dark.
    outwards = mesh.vertex_normals[left].sum(axis=1)
    is_over = (coarse.face_normals * outwards).sum(axis=1) < 0
    coarse.faces[is_over] = coarse.faces[is_over, ::-1]
    return coarse


def stone_data(mesh: "trimesh.Trimesh") -> dict[str, Any]:
    """The data that `stoneViewer` draws, ready for JSON.

    `mesh` is the stone (mm), as `coarsen` returns it. The result has ``vertices`` (float32, about
    ``centre``) and ``faces`` (uint32), each as base64, row by row; ``centre`` and ``bounds`` in mm;
    ``axes``, the stone's principal axes, the longest first.
    """
    low, high = mesh.bounds
    centre = (low + high) / 2
    axes = np.linalg.eigh(np.cov(np.asarray(mesh.vertices).T))[1].T[::-1]
    # the signs that eigh gives are arbitrary
    axes = axes * np.sign([axis[np.abs(axis).argmax()] for axis in axes])[:, np.newaxis]
    return {
        "vertices": packed(mesh.vertices - centre, "<f4"),
        "faces": packed(mesh.faces, "<u4"),
        "centre": centre.tolist(),
        "bounds": [low.tolist(), high.tolist()],
        "axes": axes.tolist(),
    }


def packed(values: np.ndarray, kind: str) -> str:
    """Numbers as base64 of their bytes, row by row; `kind` is that of NumPy."""
    content = np.ascontiguousarray(values, dtype=kind).tobytes()
    return base64.b64encode(content).decode("ascii")
