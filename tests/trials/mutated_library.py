"""Use mutated compiled scenes, whose checksums are valid, through the C library.

``python mutated_library.py SCENE FIRST COUNT FOLDER`` prints a line per mutation: number, description, and
"refused" or "answered", as for Python. The library reads poses and visibility from the tables of parts,
Python from the description; the two agree unless one of them was mutated.
"""

import contextlib
import json
import sys

import mutated_scenes
import numpy as np

import proximity
from benchmarks.digest.library import LibraryScene


def use(scene):
    """Call every query of a scene."""
    points = np.random.default_rng(1).uniform(-0.12, 0.12, (20, 3))
    points[-1] = (1e3, 0.0, 0.0)
    names = scene.names
    for step in range(3):
        mutated_scenes.ask(scene, points)
        scene.move_many([names[0]], [np.eye(4)] if step else [np.diag([-1.0, -1.0, 1.0, 1.0])])
        scene.hide(names[-1], not step)


def outcome(path, what):
    """Open a mutated file, use its scene and return the outcome."""
    try:
        scene = LibraryScene(path)
    except proximity.MeshFormatError as refused:
        with contextlib.suppress(proximity.MeshFormatError):
            proximity.load(path)
            return (
                "refused"
                if "frames[" in what or "parts[" in what
                else f"refused, unlike in Python: {refused}"
            )
        return "refused"
    use(scene)
    return "answered"


def main(name, first, count, folder):
    """Run *count* mutations from number *first*."""
    path = mutated_scenes.prepared(name, folder)
    for number, what in mutated_scenes.changes(path, name, first, count):
        print(json.dumps([number, what, mutated_scenes.told(outcome, path, what)]), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4])
