"""The queries that solids and scenes answer alike."""

from proximity.scene.line_queries import LineQueries
from proximity.scene.point_queries import PointQueries


class Queries(PointQueries, LineQueries):
    """Distance, inside, rays and segments; a base for what has a `Model`."""

    __slots__ = ()
