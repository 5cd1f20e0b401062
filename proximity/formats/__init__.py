"""Readers of mesh files. No other package knows formats, units and scene graphs.

`read_geometries` returns every mesh of a file, scaled to metres and cut into triangles, without merging,
dropping or repairs. Holes that a 3MF file declares are cut out. Partly readable files are refused: the counts
and sizes that a file declares are compared with its contents, in every format.

STL, PLY, OFF, OBJ and 3MF are read here: trimesh keeps no rows of polygons, cuts concave ones wrongly,
reorders OBJ faces by material, takes damaged files for empty ones and loses placements of 3MF objects. It
reads rare dialects only. glTF is read here too, STEP by cascadio (OpenCASCADE), with additional checks.
"""

from proximity.formats.contents import STEP_TOLERANCE, UNPACKED_LIMIT, FileContents, Geometry
from proximity.formats.file_reader import read_geometries
from proximity.formats.format_detection import EXTENSIONS
from proximity.formats.units import SYNONYMS, UNITS, likely_unit, metres_per_unit, size_notes, unit_name

__all__ = [
    "EXTENSIONS",
    "STEP_TOLERANCE",
    "SYNONYMS",
    "UNITS",
    "UNPACKED_LIMIT",
    "FileContents",
    "Geometry",
    "likely_unit",
    "metres_per_unit",
    "read_geometries",
    "size_notes",
    "unit_name",
]
