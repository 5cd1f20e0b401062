"""Kernels of NVIDIA Warp for its side of the comparison; imported only where Warp is installed."""

import warp as wp

wp.set_module_options({"enable_backward": False})

FAR = wp.constant(wp.float32(1.0e30))
Points = wp.array(dtype=wp.vec3)
Floats = wp.array(dtype=wp.float32)


@wp.kernel
def distance(mesh: wp.uint64, points: Points, distances: Floats):
    row = wp.tid()
    hit = wp.mesh_query_point_no_sign(mesh, points[row], FAR)
    distances[row] = wp.length(points[row] - wp.mesh_eval_position(mesh, hit.face, hit.u, hit.v))


@wp.kernel
def closest(mesh: wp.uint64, points: Points, nearest: Points):
    row = wp.tid()
    hit = wp.mesh_query_point_no_sign(mesh, points[row], FAR)
    nearest[row] = wp.mesh_eval_position(mesh, hit.face, hit.u, hit.v)


@wp.kernel
def signed_by_normal(mesh: wp.uint64, points: Points, distances: Floats):
    row = wp.tid()
    hit = wp.mesh_query_point_sign_normal(mesh, points[row], FAR)
    gap = wp.length(points[row] - wp.mesh_eval_position(mesh, hit.face, hit.u, hit.v))
    distances[row] = hit.sign * gap


@wp.kernel
def signed_by_votes(mesh: wp.uint64, points: Points, distances: Floats):
    row = wp.tid()
    hit = wp.mesh_query_point(mesh, points[row], FAR)
    gap = wp.length(points[row] - wp.mesh_eval_position(mesh, hit.face, hit.u, hit.v))
    distances[row] = hit.sign * gap


@wp.kernel
def signed_by_parity(mesh: wp.uint64, points: Points, distances: Floats):
    row = wp.tid()
    hit = wp.mesh_query_point_sign_parity(mesh, points[row], FAR)
    gap = wp.length(points[row] - wp.mesh_eval_position(mesh, hit.face, hit.u, hit.v))
    distances[row] = hit.sign * gap


@wp.kernel
def signed_by_winding(mesh: wp.uint64, points: Points, distances: Floats):
    row = wp.tid()
    hit = wp.mesh_query_point_sign_winding_number(mesh, points[row], FAR)
    gap = wp.length(points[row] - wp.mesh_eval_position(mesh, hit.face, hit.u, hit.v))
    distances[row] = hit.sign * gap


@wp.kernel
def cast(mesh: wp.uint64, origins: Points, directions: Points, distances: Floats):
    row = wp.tid()
    hit = wp.mesh_query_ray(mesh, origins[row], directions[row], FAR)
    distances[row] = wp.where(hit.result, hit.t, wp.inf)
