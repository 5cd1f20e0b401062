"""Mesh files of every format, generated for tests; imports nothing from the package.

Polygons are lists of vertex rows of any length; every function returns the bytes of the file.
"""

import io
import json
import struct
import zipfile

import numpy as np


def stl_binary(vertices, faces, header=b"") -> bytes:
    """Binary STL; positions are rounded to float32."""
    facets = np.zeros(len(faces), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    facets["v"] = np.asarray(vertices)[np.asarray(faces)]
    return header.ljust(80, b"\0") + struct.pack("<I", len(faces)) + facets.tobytes()


def stl_ascii(vertices, faces, name="part") -> bytes:
    """ASCII STL, one solid, positions to the last bit."""
    lines = [f"solid {name}"]
    for face in faces:
        lines += ["  facet normal 0 0 0", "    outer loop"]
        lines += ["      vertex " + _numbers(vertices[k]) for k in face]
        lines += ["    endloop", "  endfacet"]
    return "\n".join([*lines, f"endsolid {name}", ""]).encode()


def off(vertices, polygons) -> bytes:
    """OFF."""
    rows = [f"{len(p)} " + " ".join(str(k) for k in p) for p in polygons]
    return "\n".join(
        ["OFF", f"{len(vertices)} {len(polygons)} 0", *map(_numbers, vertices), *rows, ""]
    ).encode()


def obj(vertices, polygons) -> bytes:
    """OBJ."""
    rows = ["f " + " ".join(str(k + 1) for k in p) for p in polygons]
    return "\n".join([*("v " + _numbers(v) for v in vertices), *rows, ""]).encode()


def ply_header(layout, vertex_count, face_count, scalar="double") -> bytes:
    """Header of a PLY file with x, y, z and a list of corners."""
    return (
        f"ply\nformat {layout} 1.0\ncomment made for a test\nelement vertex {vertex_count}\n"
        f"property {scalar} x\nproperty {scalar} y\nproperty {scalar} z\n"
        f"element face {face_count}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()


def ply_ascii(vertices, polygons) -> bytes:
    """ASCII PLY."""
    rows = [f"{len(p)} " + " ".join(str(k) for k in p) for p in polygons]
    text = "\n".join([*map(_numbers, vertices), *rows, ""])
    return ply_header("ascii", len(vertices), len(polygons)) + text.encode()


def ply_binary(vertices, polygons, order="<", count=("uchar", "B")) -> bytes:
    """Binary PLY of either byte order; *count*: the type of list lengths, in PLY and struct notation."""
    layout = "binary_little_endian" if order == "<" else "binary_big_endian"
    rows = b"".join(struct.pack(f"{order}{count[1]}{len(p)}i", len(p), *p) for p in polygons)
    return (
        ply_header(layout, len(vertices), len(polygons)).replace(b"uchar", count[0].encode())
        + np.asarray(vertices, dtype=order + "f8").tobytes()
        + rows
    )


def gltf_document(meshes, nodes, **extra) -> tuple[dict, bytes]:
    """A glTF header and its buffer; *meshes* are lists of (vertices, faces), one pair per primitive."""
    blob, views, accessors, entries = b"", [], [], []
    for mesh in meshes:
        primitives = []
        for vertices, faces in mesh:
            for array, component, kind in (
                (np.asarray(vertices, dtype="<f4"), 5126, "VEC3"),
                (np.asarray(faces, dtype="<u4").ravel(), 5125, "SCALAR"),
            ):
                views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": array.nbytes})
                accessors.append(
                    {
                        "bufferView": len(views) - 1,
                        "componentType": component,
                        "type": kind,
                        "count": len(array),
                    }
                )
                blob += array.tobytes()
            primitives.append({"attributes": {"POSITION": len(accessors) - 2}, "indices": len(accessors) - 1})
        entries.append({"primitives": primitives})
    children = {child for node in nodes for child in node.get("children", [])}
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [k for k in range(len(nodes)) if k not in children]}],
        "nodes": nodes,
        "meshes": entries,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(blob)}],
        **extra,
    }
    return header, blob


def glb(header, blob) -> bytes:
    """GLB of a document."""
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    chunks = (
        struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(blob), 0x004E4942) + blob
    )
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def threemf_model(objects, items, unit=' unit="millimeter"') -> str:
    """XML of a 3MF model: objects {id: (vertices, faces)}, items [(id, transform)]."""
    parts = []
    for key, (vertices, faces) in objects.items():
        points = "".join('<vertex x="{!r}" y="{!r}" z="{!r}"/>'.format(*map(float, v)) for v in vertices)
        triangles = "".join('<triangle v1="{}" v2="{}" v3="{}"/>'.format(*f) for f in faces)
        parts.append(
            f'<object id="{key}" name="part{key}" type="model"><mesh><vertices>{points}</vertices>'
            f"<triangles>{triangles}</triangles></mesh></object>"
        )
    places = "".join(f'<item objectid="{key}" transform="{transform}"/>' for key, transform in items)
    return (
        f'<?xml version="1.0"?><model{unit} xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
        f"<resources>{''.join(parts)}</resources><build>{places}</build></model>"
    )


def threemf(model, name="3D/3dmodel.model", **others) -> bytes:
    """3MF archive of a model, with other models in the same folder by their file stems."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, model)
        for stem, other in others.items():
            archive.writestr(f"3D/{stem}.model", other)
    return out.getvalue()


def _numbers(values) -> str:
    return " ".join(repr(float(value)) for value in values)
