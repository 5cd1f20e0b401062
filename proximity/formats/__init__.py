"""Readers of mesh files: the only package that knows formats, units and scene graphs.

`read_geometries` gives every mesh of a file as it stands there: nothing is merged, dropped or repaired,
only scaled to metres and cut into triangles; what a 3MF calls a hole is cut out. A file of which only a part
can be read is refused: what a file declares is compared with what it holds, format by format, whoever reads.

STL, PLY, OFF, OBJ and 3MF are read here: trimesh keeps no rows of polygons, cuts concave ones wrongly,
reorders OBJ faces by material, takes damaged files for empty ones and loses placements of 3MF objects. It is
asked for rare dialects only. glTF is read here too, STEP by cascadio (OpenCASCADE), behind checks of its own.
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
