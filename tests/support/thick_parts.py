"""Parts with known walls. Imports nothing from the package."""

import numpy as np
from manifold3d import CrossSection, Manifold


def mesh_of(solid):
    """The mesh of a solid of manifold3d."""
    mesh = solid.to_mesh64()
    return mesh.vert_properties[:, :3], mesh.tri_verts.astype(int)


def block(lower, upper):
    """An axis-aligned block."""
    return Manifold.cube(np.subtract(upper, lower)).translate(lower)


def prism(angle, length=10.0, width=4.0):
    """A wedge along y, with a face in z = 0, an edge along x = 0, and that angle at the edge."""
    top = [length * np.cos(angle), length * np.sin(angle)]
    profile = [[0.0, 0.0], [length, 0.0], top]
    vertices = np.array([[x, y, z] for y in (0.0, width) for x, z in profile])
    faces = [[0, 1, 2], [3, 5, 4], [0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2], [2, 5, 3], [2, 3, 0]]
    return vertices, np.array(faces)


def tube(inner, outer, height, sides):
    """A tube about z; facets of both surfaces are parallel."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    up = np.array([0.0, 0.0, height])
    vertices = np.concatenate([outer * ring, outer * ring + up, inner * ring, inner * ring + up])
    a, b = np.arange(sides), (np.arange(sides) + 1) % sides
    quads = [(a, b, b + sides, a + sides), (b + 2 * sides, a + 2 * sides, a + 3 * sides, b + 3 * sides)]
    quads += [(a + sides, b + sides, b + 3 * sides, a + 3 * sides), (b, a, a + 2 * sides, b + 2 * sides)]
    faces = [np.stack(each, axis=1) for p, q, r, s in quads for each in ([p, q, r], [p, r, s])]
    return vertices, np.concatenate(faces)


def covered_pocket():
    """A plate of 4 with a pocket down to 3, and below it a flat cavity that is inclined by 60 degrees."""
    cavity = [[9.05, 1.12], [9.95, 2.68], [9.95, 2.73], [9.05, 1.17]]
    hollow = CrossSection([cavity]).extrude(10.0).rotate([90.0, 0.0, 0.0]).translate([0.0, 15.0, 0.0])
    return mesh_of(block((0, 0, 0), (20, 20, 4)) - block((9.2, 8, 3), (9.8, 12, 5)) - hollow)


def surface_points(mesh, count, seed):
    """Points within faces, by area, and their faces."""
    rng = np.random.default_rng(seed)
    corners = mesh[0][mesh[1]]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    faces = rng.choice(len(area), count, p=area / area.sum())
    weights = rng.dirichlet(np.ones(3), count)
    return np.einsum("ij,ijk->ik", weights, corners[faces]), faces
