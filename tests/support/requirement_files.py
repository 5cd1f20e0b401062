"""Scenes and files of requirements for tests."""

import numpy as np
import shapes

from proximity import LoadReport, Pose, Scene, Solid


def save_cubes(folder, name="cubes.prox", *, hidden=(), closed=True, deviation=0.0):
    """Save cubes of 10 mm: base; near, 2 mm from it; deep, 1 mm in it; core, inside it."""
    faces = slice(None) if closed else slice(0, -1)
    mesh = shapes.cube(0.01, (0.0, 0.0, 0.0))
    solids = [
        Solid(mesh[0], mesh[1][faces], name="base"),
        Solid(*mesh, name="near"),
        Solid(*mesh, name="deep"),
        Solid(*shapes.cube(0.002, (0.0, 0.0, 0.0)), name="core"),
    ]
    scene = Scene(solids, report=LoadReport("cubes.step", "STEP", "mm", True, (), deviation))
    for part, place in (("near", [0.0, 0.012, 0.0]), ("deep", [0.009, 0.0, 0.0])):
        scene.move(part, Pose(None, place))
    for part in hidden:
        scene.hide(part)
    scene.save(folder / name)
    return name


def approximated_sphere(radius, subdivisions, *, is_inside):
    """Return triangles inside a sphere, or around it, and their largest distance from it."""
    vertices, faces = shapes.sphere(1.0, subdivisions)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    inner = float(np.einsum("ij,ij->i", a, normals).min())  # radius of the sphere inside the triangles
    scale = radius if is_inside else radius / inner
    return scale * vertices, faces, scale * (1.0 - inner)


def requirement(text, name="r"):
    """Return an entry of the list of requirements."""
    return f'[[require]]\nname = "{name}"\n{text}\n'


def write_file(folder, *entries, head='model = "cubes.prox"', name="fit.toml"):
    """Write a file of requirements. Entries without a header get one, with a number as name."""
    texts = [
        each if each.startswith("[[") else requirement(each, f"r{number}")
        for number, each in enumerate(entries)
    ]
    path = folder / name
    path.write_text(head + "\n" + "".join(texts), encoding="utf-8")
    return path
