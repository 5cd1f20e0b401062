"""Deviations of public STEP files, against dense samples measured by an OpenCASCADE binding (OCP)."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("OCP", reason="measures with OpenCASCADE")

from OCP.BRep import BRep_Tool
from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeVertex
from OCP.BRepExtrema import BRepExtrema_DistShapeShape
from OCP.BRepMesh import BRepMesh_IncrementalMesh
from OCP.gp import gp_Pnt, gp_Trsf
from OCP.Interface import Interface_Static
from OCP.STEPCAFControl import STEPCAFControl_Reader
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDF import TDF_ChildIterator
from OCP.TDocStd import TDocStd_Document
from OCP.TopAbs import TopAbs_FACE
from OCP.TopExp import TopExp_Explorer
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS
from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

import proximity
from proximity import Pose, Scene, formats
from proximity.formats.contents import Geometry

FILES = [
    "cad/featuretype.STEP",
    "cad/box_sides.STEP",
    "assemblies/as1-oc-214.stp",
    "assemblies/bracket-with-bolts.step",
    "assemblies/iris-box.step",
]
NEAR = 2e-9  # m, rounding of single precision and of OpenCASCADE
SAMPLES = 150  # points measured for each face, each way


def faces_of(shape):
    explorer, found = TopExp_Explorer(shape, TopAbs_FACE), []
    while explorer.More():
        found.append(TopoDS.Face(explorer.Current()))
        explorer.Next()
    return found


def read_products(path):
    """Return the shape and the faces of each product of a file, in its own frame."""
    document = TDocStd_Document(TCollection_ExtendedString("x"))
    reader = STEPCAFControl_Reader()
    Interface_Static.SetCVal_s("xstep.cascade.unit", "MM")
    reader.ReadFile(str(path))
    reader.Transfer(document)
    labels, products = TDF_ChildIterator(XCAFDoc_DocumentTool.ShapesLabel_s(document.Main())), []
    while labels.More():
        if XCAFDoc_ShapeTool.IsSimpleShape_s(labels.Value()):
            shape = XCAFDoc_ShapeTool.GetShape_s(labels.Value())
            products.append((shape, faces_of(shape)))
        labels.Next()
    return document, products


def nodes_of(face):
    """Return points of a face, m, from a fine triangulation of it, with the edges."""
    BRepMesh_IncrementalMesh(face, 0.002, False, 0.05, True)
    location = TopLoc_Location()
    mesh = BRep_Tool.Triangulation_s(face, location)
    move = location.Transformation()
    points = [mesh.Node(row).Transformed(move) for row in range(1, mesh.NbNodes() + 1)]
    return np.array([[point.X(), point.Y(), point.Z()] for point in points]) * 1e-3


def distances_to_face(face, points):
    """Return the distances of points, m, from a face."""
    found = []
    for point in points * 1e3:
        vertex = BRepBuilderAPI_MakeVertex(gp_Pnt(*point.tolist())).Vertex()
        found.append(BRepExtrema_DistShapeShape(vertex, face).Value())
    return np.array(found) * 1e-3


def distances_to_triangles(triangles, points):
    """Return the distances of points from triangles, by comparing all of them."""
    best = np.full(len(points), np.inf)
    a, b, c = triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    area = np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    for row, point in enumerate(points):
        for start, end in ((a, b), (b, c), (c, a)):
            side = end - start
            share = ((point - start) * side).sum(1) / np.maximum((side * side).sum(1), 1e-300)
            foot = start + np.clip(share, 0.0, 1.0)[:, None] * side
            best[row] = min(best[row], np.linalg.norm(point - foot, axis=1).min())
        turns = [
            (np.cross(end - start, point - start) * normal).sum(1) for start, end in ((a, b), (b, c), (c, a))
        ]
        is_inside = np.min(turns, axis=0) >= 0.0
        if is_inside.any():
            heights = np.abs(((point - a) * normal).sum(1) / area)[is_inside]
            best[row] = min(best[row], heights.min())
    return best


def measured(face, triangles, random):
    """Return the largest distances found from the triangles to the face, and back."""
    sides = (triangles + np.roll(triangles, -1, axis=1)) / 2
    points = np.concatenate([triangles.mean(axis=1), sides.reshape(-1, 3)])
    points = points[random.permutation(len(points))[:SAMPLES]]
    nodes = nodes_of(face)
    nodes = nodes[random.permutation(len(nodes))[:SAMPLES]]
    return distances_to_face(face, points).max(), distances_to_triangles(triangles, nodes).max()


def alike(products, part):
    """Return the product that a part was made of."""
    corners = part.vertices[part.faces]
    middles = corners[np.unique(part.source_faces, return_index=True)[1]].mean(axis=1)
    same = [product for product in products if len(product[1]) == len(part.deviations)]
    gaps = [
        max(distances_to_face(*pair)[0] for pair in zip(faces, middles[:, None], strict=True))
        for _, faces in same
    ]
    assert gaps and min(gaps) < 1e-3, part.name
    return same[int(np.argmin(gaps))]


def moved(shape, pose):
    """Return a shape at a pose, m."""
    move = gp_Trsf()
    rows = np.column_stack([pose.rotation, 1e3 * pose.translation])
    move.SetValues(*rows.ravel().tolist())
    return shape.Moved(TopLoc_Location(move), False)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_bounds_contain_what_opencascade_measures(shared_data, name):
    random = np.random.default_rng(5)
    keep, products = read_products(shared_data / name)
    ratios, seen = [], set()
    for part in formats.read_geometries(shared_data / name).geometries:
        if id(part.faces) in seen:
            continue
        seen.add(id(part.faces))
        corners = part.vertices[part.faces]
        for row, face in enumerate(alike(products, part)[1]):
            there, back = measured(face, corners[part.source_faces == row], random)
            bound = part.deviations[row]
            assert max(there, back) <= bound + NEAR, (part.name, row, there, back, bound)
            if max(there, back) > 1e-7:
                ratios.append(bound / max(there, back))
    ratios = np.array(ratios)
    print(name, len(ratios), np.quantile(ratios, [0.5, 0.95, 1.0]), (ratios > 2).sum())
    assert (ratios <= 2.0).mean() >= 0.8
    assert keep is not None


@pytest.mark.slow
def test_distances_of_cad_parts_are_within_the_bounds(shared_data):
    """Five hundred pairs of small parts at random poses."""
    random, documents, found = np.random.default_rng(3), [], {}
    for name in FILES[1:]:
        document, products = read_products(shared_data / name)
        documents.append(document)
        for part in proximity.load(shared_data / name).parts:
            count = len(part.deviation_by_face)
            if count <= 16 and len(np.unique(part.source_faces)) == count:
                mesh = part.solid.mesh
                deviations = part.deviation_by_face
                of_file = Geometry(
                    "", mesh.vertices, mesh.faces, part.source_faces, part.pose, False, deviations
                )
                found[part.name] = part, alike(products, of_file)[0]
    assert len(found) > 5
    widths = []
    for _ in range(500):
        names = random.choice(sorted(found), 2, replace=False)
        parts = [replace(found[name][0], pose=random_pose(random)) for name in names]
        answer = Scene(parts).clearance(*names, surface="cad")
        first, second = (moved(found[part.name][1], part.pose) for part in parts)
        true = BRepExtrema_DistShapeShape(first, second).Value() * 1e-3
        assert answer.lower - NEAR <= true <= answer.distance + NEAR, names
        widths.append(answer.distance - answer.lower)
    print("widths", np.quantile(widths, [0.5, 1.0]))


def random_pose(random):
    """Return a pose within a quarter of a metre, with any rotation."""
    quaternion = random.normal(size=4)
    return Pose.from_quaternion(quaternion / np.linalg.norm(quaternion), random.uniform(-0.15, 0.15, 3))
