"""Sound and broken meshes as programs have them in memory."""

import numpy as np
import shapes

ONE = np.array([[0, 1, 2]], np.int32)
CORNER = np.eye(3)
TOUCHING = shapes.join(shapes.cube(), shapes.moved(shapes.cube(), (1, 0, 0)))
NAMED = {
    "cube": shapes.cube(),
    "soup": shapes.soup(*shapes.sphere(1.0, 2)),
    "inside out": shapes.inside_out(shapes.torus()),
    "hollow": shapes.hollow_cube(),
    "hollow inside out": shapes.inside_out(shapes.hollow_cube()),
    "open": shapes.open_box(),
    "sheet": shapes.grid(),
    "one face": (CORNER, ONE),
    "band": shapes.strip(8),
    "Moebius": shapes.strip(9, half_turns=1),
    "touching": TOUCHING,
    "touching soup": shapes.soup(*TOUCHING),
    "crossing": shapes.join(shapes.sphere(1.0, 2), shapes.moved(shapes.sphere(1.0, 2), (0.5, 0.1, 0.2))),
    "voxels": shapes.voxels(np.random.default_rng(3).random((4, 4, 4)) < 0.5),
    "far away": shapes.moved(shapes.torus(0.1, 0.03), (1e6, -2e6, 0)),
    "tiny": shapes.sphere(1e-12, 2),
    "many bodies": shapes.join(*(shapes.moved(shapes.sphere(0.1, 1), (x, 0, 0)) for x in range(20))),
}


def torn(name, seed):
    """A mesh with missing, reversed and duplicate faces, and nearly equal vertices."""
    rng = np.random.default_rng(seed)
    vertices, faces = shapes.soup(*NAMED[name])
    vertices = vertices + rng.choice([0.0, 1e-9, 1e-7], vertices.shape) * rng.standard_normal(vertices.shape)
    faces = faces[rng.random(len(faces)) < rng.choice([0.8, 0.97, 1.0])]
    faces = np.concatenate([faces, faces[rng.random(len(faces)) < 0.05]])
    is_turned = rng.random(len(faces)) < rng.choice([0.0, 0.1])
    faces[is_turned] = faces[is_turned][:, ::-1]
    return vertices, faces
