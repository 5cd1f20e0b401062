"""Small meshes by formula: functions that return (vertices (V, 3) float64, faces (F, 3) int64).

Faces wind counter-clockwise seen from outside. Lengths have no unit. Imports nothing from the package.
"""

import numpy as np

Mesh = tuple[np.ndarray, np.ndarray]

_CUBE_FACES = np.array(
    [
        [0, 2, 3], [0, 3, 1],  # z = 0
        [4, 5, 7], [4, 7, 6],  # z = 1
        [0, 1, 5], [0, 5, 4],  # y = 0
        [2, 6, 7], [2, 7, 3],  # y = 1
        [0, 4, 6], [0, 6, 2],  # x = 0
        [1, 3, 7], [1, 7, 5],  # x = 1
    ]
)  # fmt: skip


def tetrahedron() -> Mesh:
    """The corner of the unit cube; volume 1/6."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float64)
    return vertices, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def cube(size=1.0, center=(0.5, 0.5, 0.5)) -> Mesh:
    """A cube of 8 vertices and 12 faces, [0, 1]³ by default; vertex number is x + 2 y + 4 z."""
    corners = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)], dtype=np.float64)
    return np.asarray(center, dtype=np.float64) + (corners - 0.5) * size, _CUBE_FACES.copy()


def box(lower, upper) -> Mesh:
    """An axis-aligned box of 12 faces."""
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    return lower + cube()[0] * (upper - lower), _CUBE_FACES.copy()


def open_box() -> Mesh:
    """The unit cube without its lid (z = 1): 10 faces, 4 boundary edges."""
    vertices, faces = cube()
    return vertices, np.delete(faces, [2, 3], axis=0)


def hollow_cube(size=3.0, cavity_size=1.0, center=(0.0, 0.0, 0.0)) -> Mesh:
    """A cube with a cubic cavity at its centre: one body, two shells, volume size³ - cavity_size³."""
    return join(cube(size, center), inside_out(cube(cavity_size, center)))


def octahedron(radius=1.0) -> Mesh:
    """Six vertices on the axes, 8 faces; volume 4/3 radius³."""
    vertices = radius * np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]], float)
    faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    return vertices, np.array(faces)


def sphere(radius=1.0, subdivisions=3) -> Mesh:
    """An icosahedron whose faces are quartered *subdivisions* times; every vertex is at *radius*."""
    g = (1 + 5**0.5) / 2
    vertices = np.array(
        [[-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g],
         [0, -1, -g], [0, 1, -g], [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1]]
    )  # fmt: skip
    faces = np.array(
        [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2],
         [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5],
         [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]]
    )  # fmt: skip
    for _ in range(subdivisions):
        vertices, faces = quartered(vertices, faces)
    return radius * vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces


def quartered(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
    """Cut each face into four at the midpoints of its edges."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    pairs, inverse = np.unique(edges, axis=0, return_inverse=True)
    middle = len(vertices) + inverse.reshape(-1, 3)  # of edge k
    a, b, c = faces.T
    ab, bc, ca = middle.T
    quarters = [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
    new_faces = np.concatenate([np.stack(quarter, axis=1) for quarter in quarters])
    return np.concatenate([vertices, vertices[pairs].mean(axis=1)]), new_faces


def torus(major_radius=2.0, minor_radius=0.5, n=24, m=12) -> Mesh:
    """A torus about z of n times m quadrilaterals, each cut in two: 2 n m faces, n m vertices."""
    u, v = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    ring = major_radius + minor_radius * np.cos(v)
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), minor_radius * np.sin(v)], axis=-1).reshape(
        -1, 3
    )
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    a, b = i * m + j, (i + 1) % n * m + j
    c, d = (i + 1) % n * m + (j + 1) % m, i * m + (j + 1) % m
    return vertices, np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ([a, b, c], [a, c, d])])


def strip(n=8, *, half_turns=0) -> Mesh:
    """A closed band about z of 2 n faces; with one half turn a non-orientable Moebius strip."""
    angle = 2 * np.pi * np.arange(n) / n
    tilt = half_turns * angle / 2
    rows = []
    for side in (-0.3, 0.3):
        ring = 1 + side * np.sin(tilt)
        rows.append(np.stack([ring * np.cos(angle), ring * np.sin(angle), side * np.cos(tilt)], axis=1))
    near, far = np.arange(n), np.arange(n) + n
    next_near, next_far = np.roll(near, -1), np.roll(far, -1)
    if half_turns % 2:
        next_near[-1], next_far[-1] = next_far[-1], next_near[-1]
    faces = [np.stack([near, next_near, next_far], axis=1), np.stack([near, next_far, far], axis=1)]
    return np.concatenate(rows), np.concatenate(faces)


def grid(n=4, m=4) -> Mesh:
    """A flat sheet in z = 0 of n times m unit squares, facing up: 2 n m faces."""
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(m + 1.0), indexing="ij")
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    a = (i * (m + 1) + j).ravel()
    b, c, d = a + m + 1, a + m + 2, a + 1
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1), faces


def soup(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
    """The same triangles without shared vertices, as in an STL file."""
    return vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)


def join(*meshes: Mesh) -> Mesh:
    """Concatenate meshes without sharing vertices."""
    offsets = np.cumsum([0] + [len(vertices) for vertices, _ in meshes])
    faces = [faces + offset for (_, faces), offset in zip(meshes, offsets, strict=False)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces)


def inside_out(mesh: Mesh) -> Mesh:
    """Reverse the winding of all faces."""
    return mesh[0], mesh[1][:, ::-1].copy()


def moved(mesh: Mesh, offset) -> Mesh:
    """Translate a mesh."""
    return mesh[0] + np.asarray(offset, dtype=np.float64), mesh[1]


def rotation(seed: int) -> np.ndarray:
    """A random rotation matrix (3, 3)."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    q[:, 0] *= np.linalg.det(q)
    return q


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Signed volume by the divergence theorem, about the first vertex in use."""
    a, b, c = np.moveaxis(vertices[faces] - vertices[faces[0, 0]], 1, 0)
    return float((a * np.cross(b, c)).sum() / 6)


def voxels(cells: np.ndarray) -> Mesh:
    """The surface of the True unit cells of a 3-d grid: every outer side of a cell, cut in two, as a soup."""
    padded = np.pad(cells, 1)
    triangles = []
    for axis in range(3):
        for way in (1, -1):
            bare = np.argwhere(padded & ~np.roll(padded, -way, axis=axis)) - 1.0
            u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            a = bare + (np.eye(3)[axis] if way > 0 else 0.0)
            b, c, d = a + u, a + u + v, a + v
            for corners in ([a, b, c], [a, c, d]):
                triangles.append(np.stack(corners[::way], axis=1))
    vertices = np.concatenate(triangles).reshape(-1, 3)
    return vertices, np.arange(len(vertices)).reshape(-1, 3)
