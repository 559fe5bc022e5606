"""MuJoCo's geoms as polygons, in the geom's own frame and in metres.

A mesh is its vertices, shape (V, 3), and its faces, shape (F, 4): vertex indices, anticlockwise seen from outside. A
triangle repeats its last vertex.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray

__all__ = ["Mesh", "tessellate"]

Mesh = tuple[FloatArray, npt.NDArray[np.intp]]

_AROUND = (12, 40)
"""Fewest and most faces around a cylinder, capsule or sphere; multiples of four."""
_CUTS = 16
"""Most pieces that a flat or straight side is cut into."""
_MESH_CELLS = 24
"""A mesh is simplified until its longest side has this many cells: more is not visible and would take seconds."""
_MESH_FACES = 3000
"""Meshes with fewer faces are drawn as they are."""


def tessellate(
    model: mujoco.MjModel, kind: int, size: Sequence[float], mesh: int = -1, cell: float = math.inf
) -> Mesh | None:
    """Polygons of one geom; None for what has no surface of its own here (planes, height fields, lines).

    Args:
        model: holds the meshes.
        kind: `mujoco.mjtGeom`.
        size: m, three numbers as in `mujoco.MjvGeom.size`: radius, radius, half length; or half extents.
        mesh: index of the mesh asset, for mesh geoms.
        cell: m, about the longest side of a polygon. A painter sorts polygons by the distance of their centres, which
            is wrong by up to half a polygon where surfaces cross or differ in polygon size.
    """
    types = mujoco.mjtGeom
    x, y, z = (float(value) for value in size)
    if kind == types.mjGEOM_BOX:
        return _box(x, y, z, cell)
    around = 4 * max(_AROUND[0] // 4, min(_AROUND[1] // 4, math.ceil(2 * math.pi * max(x, y) / cell / 4)))
    if kind in {types.mjGEOM_SPHERE, types.mjGEOM_ELLIPSOID}:
        profile = [(math.sin(a), -math.cos(a)) for a in np.linspace(0.0, np.pi, around // 2 + 1)]
        return _revolve(profile, around, (x, y, z))
    if kind == types.mjGEOM_CAPSULE:
        quarter = np.linspace(0.0, np.pi / 2, around // 4 + 1)
        south = [(x * math.sin(a), -z - x * math.cos(a)) for a in quarter]
        north = [(x * math.cos(a), z + x * math.sin(a)) for a in quarter]
        return _revolve([*south, *_between(south[-1], north[0], cell), *north], around)
    if kind == types.mjGEOM_CYLINDER:
        corners = [(0.0, -z), (x, -z), (x, z), (0.0, z)]
        inner = [_between(start, stop, cell) for start, stop in pairwise(corners)]
        profile = [point for corner, points in zip(corners, [*inner, []], strict=True) for point in (corner, *points)]
        return _revolve(profile, around)
    if kind == types.mjGEOM_MESH and mesh >= 0:
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        start, stop = model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh]
        return _simplify(model.mesh_vert[first : first + count].astype(np.float64), model.mesh_face[start:stop])
    return None


def _between(start: tuple[float, float], stop: tuple[float, float], cell: float) -> list[tuple[float, float]]:
    """Points that cut a straight line into pieces no longer than `cell`."""
    cuts = _cuts(math.dist(start, stop), cell)
    points = np.linspace(start, stop, cuts + 1)[1:-1]
    return [(float(radius), float(height)) for radius, height in points]


def _cuts(length: float, cell: float) -> int:
    return max(1, min(_CUTS, math.ceil(length / cell)))


def _revolve(
    profile: Sequence[tuple[float, float]], around: int, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> Mesh:
    """Turn a profile of (radius, height), from south to north, about z."""
    angles = np.arange(around) * (2 * np.pi / around)
    radius, height = np.array(profile).T
    rings = np.empty((len(profile), around, 3))
    rings[..., 0] = radius[:, None] * np.cos(angles)
    rings[..., 1] = radius[:, None] * np.sin(angles)
    rings[..., 2] = height[:, None]
    index = np.arange(len(profile) * around).reshape(-1, around)
    east = np.roll(index, -1, axis=1)
    faces = np.stack([index[:-1], east[:-1], east[1:], index[1:]], axis=-1)
    return rings.reshape(-1, 3) * scale, faces.reshape(-1, 4)


def _box(x: float, y: float, z: float, cell: float) -> Mesh:
    half = np.array([x, y, z])
    vertices, faces, offset = [], [], 0
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        nu, nv = _cuts(2 * half[u], cell), _cuts(2 * half[v], cell)
        for side in (1.0, -1.0):
            grid = np.empty((nu + 1, nv + 1, 3))
            grid[..., axis] = side * half[axis]
            grid[..., u] = np.linspace(-half[u], half[u], nu + 1)[:, None]
            grid[..., v] = side * np.linspace(-half[v], half[v], nv + 1)  # mirrored, so that faces turn outward
            index = offset + np.arange(grid.shape[0] * grid.shape[1]).reshape(nu + 1, nv + 1)
            faces.append(np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1))
            vertices.append(grid.reshape(-1, 3))
            offset += vertices[-1].shape[0]
    return np.concatenate(vertices), np.concatenate([face.reshape(-1, 4) for face in faces])


def _simplify(vertices: FloatArray, triangles: npt.NDArray[np.int32]) -> Mesh:
    """Merge the vertices of each cell of a grid, and drop the triangles that collapse."""
    faces = triangles.astype(np.intp)
    if len(faces) > _MESH_FACES:
        low = vertices.min(axis=0)
        cells = np.round((vertices - low) / (np.ptp(vertices, axis=0).max() / _MESH_CELLS))
        _, member, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
        merged = np.zeros((len(count), 3))
        np.add.at(merged, member, vertices)
        vertices = merged / count[:, None]
        faces = member[faces]
        a, b, c = faces.T
        faces = np.unique(faces[(a != b) & (b != c) & (c != a)], axis=0)
    return vertices, faces[:, [0, 1, 2, 2]]
