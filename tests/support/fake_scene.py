"""An analytic scene for command-line tests: a sphere of radius 10 mm about the origin."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from proximity.pose import Pose
from proximity.scene.queries.results import NO_FACE, Feature

RADIUS = 0.010  # m


@dataclass
class FakeRepairs:
    merged_vertex_count: int = 4
    weld_distance: float = 0.0

    def describe(self):
        return "4 vertices at equal positions merged"


class FakeScene:
    """One sphere, with formulas for the queries of the command line."""

    def __init__(self, *, has_inside=True, name="ball"):
        diagnosis = SimpleNamespace(
            vertex_count=12,
            face_count=20,
            shell_count=1,
            boundary_edge_count=0,
            nonmanifold_edge_count=0,
            misoriented_edge_count=0,
            is_watertight=has_inside,
            is_oriented=True,
            volume=4.0e-6 if has_inside else np.nan,
            area=1.25e-3,
            lower=(-RADIUS,) * 3,
            upper=(RADIUS,) * 3,
            is_solid_by_manifold=has_inside,
            manifold_status="NoError" if has_inside else "NotManifold",
        )
        solid = SimpleNamespace(
            sign_method=SimpleNamespace(value="pseudo-normals" if has_inside else "none"),
            sign_reason="closed and oriented" if has_inside else "it is an open sheet",
            has_inside=has_inside,
            diagnosis=diagnosis,
            mesh=SimpleNamespace(
                vertices=np.array([[-RADIUS] * 3, [RADIUS] * 3, [0.0] * 3]),
                faces=np.array([[0, 1, 2]], np.int32),
            ),
        )
        self.parts = (
            SimpleNamespace(
                deviation=0.0,
                name=name,
                solid=solid,
                pose=Pose(),
                source_faces=np.arange(100, 200),
                repairs=FakeRepairs(),
            ),
        )
        self.part_sizes = np.full((1, 3), 2.0 * RADIUS)
        self.report = SimpleNamespace(
            path="ball.stl", format="STL binary", units="mm", units_declared=False, notes=("2 names shared",)
        )
        self.has_inside = has_inside

    @property
    def bounds(self):
        """Return the bounding box of the parts."""
        corners = np.concatenate([part.pose.point(part.solid.mesh.vertices) for part in self.parts])
        return corners.min(axis=0), corners.max(axis=0)

    def closest(self, points, *, workers=1):
        with np.errstate(invalid="ignore", over="ignore"):
            length = np.linalg.norm(points, axis=-1)
            gradient = points / length[:, None]
        is_found = np.isfinite(points).all(axis=-1)
        distance = np.where(is_found, length - RADIUS, np.nan)
        ids = np.where(is_found, 7, NO_FACE).astype(np.int32)
        return SimpleNamespace(
            signed_distance=distance if self.has_inside else abs(distance),
            distance=abs(distance),
            point=gradient * RADIUS,
            gradient=gradient,
            part=np.where(is_found, 0, NO_FACE),
            face_id=ids,
            barycentric=np.where(is_found[:, None], (0.5, 0.5, 0.0), np.nan),
            feature=np.full(len(points), Feature.EDGE, dtype=np.int8),
            is_signed=np.full(len(points), self.has_inside),
        )

    def cast(self, origins, directions, *, workers=1):
        """Intersect rays along -z only, enough to test what is passed on."""
        is_hit = (np.hypot(origins[:, 0], origins[:, 1]) < RADIUS) & (directions[:, 2] < 0.0)
        top = np.sqrt(np.where(is_hit, RADIUS**2 - origins[:, 0] ** 2 - origins[:, 1] ** 2, np.nan))
        point = np.column_stack((np.where(is_hit, origins[:, 0], np.nan), origins[:, 1], top))
        ids = np.where(is_hit, 3, NO_FACE)
        return SimpleNamespace(
            distance=np.where(is_hit, origins[:, 2] - top, np.inf),
            point=np.where(is_hit[:, None], point, np.nan),
            normal=np.where(is_hit[:, None], point / RADIUS, np.nan),
            part=np.where(is_hit, 0, NO_FACE),
            face_id=ids,
            barycentric=np.where(is_hit[:, None], (1.0, 0.0, 0.0), np.nan),
        )

    def closest_to_segments(self, starts, ends, *, workers=1):
        """Use the nearer end point of each segment."""
        nearest = np.where((abs(starts) <= abs(ends)).all(axis=-1)[:, None], starts, ends)
        hits = self.closest(nearest)
        return SimpleNamespace(
            distance=np.maximum(hits.signed_distance, 0.0),
            fraction=np.zeros(len(starts)),
            point_on_segment=nearest,
            point_on_solid=hits.point,
            part=hits.part,
            face_id=hits.face_id,
        )
