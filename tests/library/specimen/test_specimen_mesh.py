"""The pebble's mesh: closed, of the asked size, with edges of the asked length."""

import numpy as np
import pytest
import trimesh

from gstlib.specimen.pebble import Pebble, even_triangulation

OUTER = (100.38, 80.57, 29.5)


def edge_lengths(vertices, faces):
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    return edges, np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)


# On this pebble's area, equilateral triangles of the paper's edge would be 345,000 already.
@pytest.mark.parametrize(("edge_mm", "count"), [(0.3144, 370_000), (1.0, 37_000)])
def test_edges_and_size(edge_mm, count):
    vertices, faces, upper = even_triangulation(Pebble(OUTER, 0.5), edge_mm)
    edges, lengths = edge_lengths(vertices, faces)
    assert len(faces) == pytest.approx(count, rel=0.05)
    assert lengths.mean() == pytest.approx(edge_mm, rel=0.02)
    np.testing.assert_allclose(np.ptp(vertices, axis=0), OUTER, atol=0.02 * edge_mm + 0.05)
    # a closed surface without handles: V - E + F = 2
    assert len(vertices) - len(edges) + len(faces) == 2
    in_square = (np.abs(vertices[edges[:, 0], :2]).max(axis=1) < 2.5) & upper[edges[:, 0]]
    assert lengths[in_square].mean() == pytest.approx(edge_mm, rel=0.05)
    low, high = np.quantile(lengths[in_square], [0.01, 0.99])
    assert 0.6 * edge_mm < low < high < 1.5 * edge_mm


def test_use_face_agrees_with_the_points():
    pebble = Pebble(OUTER, 0.5)
    colatitude = np.linspace(0, np.pi / 2, 9)[:, None]
    x, y, z = np.moveaxis(pebble.points(colatitude, np.linspace(0, 6, 7)), -1, 0)
    np.testing.assert_allclose(pebble.use_face(x, y), z, atol=1e-5)


def test_stl_is_watertight_and_faces_out(specimen):
    mesh = trimesh.load(specimen.mesh)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0.3 * np.prod(OUTER)
    np.testing.assert_allclose(mesh.extents, OUTER, atol=0.2)
    assert specimen.mesh.stat().st_size == 84 + 50 * len(mesh.faces)


def test_use_face_looks_up_with_its_centre_at_the_origin(specimen):
    mesh = trimesh.load(specimen.mesh)
    below, above = mesh.bounds[:, 2]
    assert below < -20
    assert above < 1
    near = np.hypot(*mesh.vertices[:, :2].T) < 5
    use_face = mesh.vertices[near & (mesh.vertices[:, 2] > -5)]
    assert abs(use_face[:, 2].mean()) < 0.1
