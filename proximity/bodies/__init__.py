"""From the arrays of a file to bodies: weld, split, orient.

A body is what `Solid` wants: one connected surface, the cavities within it included, every corner one
vertex, all faces running one way, outside out. What cannot be made so stays as it is: nothing is invented,
no hole is filled, and every change is counted in `Repairs`.

`splitting` has the order of the steps; `cleaning` drops faces, `pieces` connects them across edges,
`vertex_weld` pulls near vertices together, `cavities` finds what lies within what by the `winding` number.
"""

from proximity.bodies.body_records import Body, Repairs
from proximity.bodies.body_split import split_bodies
from proximity.bodies.vertex_weld import open_edges

__all__ = ["Body", "Repairs", "open_edges", "split_bodies"]
