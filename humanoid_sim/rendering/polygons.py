"""Polygons for the software painter: made of MuJoCo's geoms, and drawn in perspective with a depth buffer.

A mesh is in the geom's own frame, in metres: its vertices, shape (V, 3), and its faces, shape (F, 4), which are vertex
indices, anticlockwise seen from outside. A triangle repeats its last vertex.

The inverse of the depth of a plane is linear in the pixel's coordinates, and so is the side of an edge on which a pixel
lies. All polygons of about the same size on the picture are therefore drawn at once.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from itertools import pairwise

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray

Mesh = tuple[FloatArray, npt.NDArray[np.intp]]

_AROUND = (12, 40)
"""Fewest and most faces around a cylinder, capsule or sphere; multiples of four."""
_CUTS = 16
"""Most pieces that a flat or straight side is cut into."""
_MESH_CELLS = 24
"""A mesh is simplified until its longest side has this many cells: more is not visible and would take seconds."""
_MESH_FACES = 3000
"""Meshes with fewer faces are drawn as they are."""
_BATCH = 1 << 19
"""Samples that are worked on at once; bounds the memory."""


def tessellate(
    model: mujoco.MjModel, kind: int, size: Sequence[float], mesh: int = -1, cell: float = math.inf
) -> Mesh | None:
    """Polygons of one geom; None for what has no surface of its own here (planes, height fields, lines).

    Args:
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


class View:
    """The perspective of a scene's camera on a picture of `width` × `height` pixels."""

    def __init__(self, scene: mujoco.MjvScene, width: int, height: int) -> None:
        left, right = scene.camera[0], scene.camera[1]  # a stereo pair
        self.eye = (left.pos.astype(np.float64) + right.pos) / 2
        forward, up = left.forward.astype(np.float64), left.up.astype(np.float64)
        self.axes = np.stack([np.cross(forward, up), -up, forward])
        self.near = float(left.frustum_near)
        self.focal = self.near * height / float(left.frustum_top - left.frustum_bottom)
        self.width, self.height = width, height
        self.centre = np.array([width / 2, height / 2])

    def crop(self, left: int, top: int, right: int, bottom: int) -> View:
        """Return the same perspective on a part of the picture, pixels from its top left."""
        part = copy.copy(self)
        part.width, part.height = right - left, bottom - top
        part.centre = self.centre - [left, top]
        return part

    def to_camera(self, points: FloatArray) -> FloatArray:
        """World points (..., 3) in m, seen from the eye: right, down, forward."""
        seen: FloatArray = (points - self.eye) @ self.axes.T
        return seen

    def to_pixels(self, points: FloatArray) -> FloatArray:
        """Camera points (..., 3) in front of the eye as pixels (..., 2), from the top left."""
        return self.centre + self.focal * points[..., :2] / points[..., 2:]


class DepthBuffer:
    """For each pixel, the nearest polygon so far."""

    def __init__(self, view: View) -> None:
        self._view = view
        # The bits of a positive float32 sort as an integer: inverse depth above, number of the polygon below.
        self._nearest = np.zeros(view.width * view.height, dtype=np.int64)
        self.count = 0
        """Polygons drawn so far."""

    def copy(self) -> DepthBuffer:
        """Return a buffer of its own, with what was drawn so far."""
        return self.crop(0, 0, self._view.width, self._view.height)

    def crop(self, left: int, top: int, right: int, bottom: int) -> DepthBuffer:
        """Return a buffer of its own for a part of the picture, with what was drawn there so far."""
        whole = self._nearest.reshape(self._view.height, self._view.width)
        other = DepthBuffer.__new__(DepthBuffer)
        other._view, other.count = self._view.crop(left, top, right, bottom), self.count
        other._nearest = whole[top:bottom, left:right].flatten()
        return other

    def numbers(self) -> npt.NDArray[np.int64]:
        """For each pixel, shape (height, width), the number of the polygon that is seen: they are counted from 0."""
        return (self._nearest & 0xFFFFFFFF).reshape(self._view.height, self._view.width)

    def draw(self, faces: FloatArray, colours: FloatArray, picture: npt.NDArray[np.uint8]) -> None:
        """Draw convex polygons that turn towards the eye into the picture where nothing nearer was drawn.

        Faces are (F, 4, 3), m, camera frame, anticlockwise seen from the eye; colours are (F, 3), in 0 to 1.
        """
        whole = (faces[..., 2] > self._view.near).all(axis=1)
        cut = np.flatnonzero(~whole & (faces[..., 2] > self._view.near).any(axis=1))
        pieces = [(index, piece) for index in cut for piece in _clip(faces[index], self._view.near)]
        faces = np.concatenate([faces[whole], *(piece[None] for _, piece in pieces)])
        colours = np.concatenate([colours[whole], colours[[index for index, _ in pieces]]])
        pixel, bits = self._insert(faces, self.count)
        won = self._nearest[pixel] == bits
        shades = (255 * np.clip(colours, 0.0, 1.0)).astype(np.uint8)
        picture.reshape(-1, 3)[pixel[won]] = shades[(bits[won] & 0xFFFFFFFF) - self.count]
        self.count += len(faces)

    def _insert(self, faces: FloatArray, first: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.int64]]:
        """Enter polygons, numbered from `first`; the pixels that they cover and what was entered for each."""
        view = self._view
        corners = view.to_pixels(faces)
        low = np.floor(np.clip(corners.min(axis=1), 0, [view.width, view.height])).astype(np.int32)
        high = np.ceil(np.clip(corners.max(axis=1), 0, [view.width, view.height])).astype(np.int32)

        # Linear functions of the pixel: which side of each edge (4), and the inverse depth; at `low` and per pixel.
        edge = np.roll(corners, -1, axis=1) - corners
        side = np.stack([edge[..., 1], -edge[..., 0], np.zeros(edge.shape[:2])], axis=-1)
        side[..., 2] = np.einsum("fki,fki->fk", side[..., :2], low[:, None] + 0.5 - corners)
        edges = side.transpose(1, 0, 2).astype(np.float32)
        normal = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
        offset = np.einsum("fi,fi->f", normal, faces.mean(axis=1))
        slope = normal[:, :2] / (offset * view.focal)[:, None]
        start = np.einsum("fi,fi->f", slope, low + 0.5 - view.centre) + normal[:, 2] / offset
        inverse_depth = np.column_stack([slope, start]).astype(np.float32)

        extent = high - low
        column_bits, row_bits = np.ceil(np.log2(np.maximum(extent, 2))).astype(int).T
        sizes = np.where((extent > 0).all(axis=1), 16 * column_bits + row_bits, -1)
        fragments = [(np.empty(0, dtype=np.intp), np.empty(0, dtype=np.int64))]
        for size in np.unique(sizes[sizes >= 0]):
            columns, rows = 1 << int(size) // 16, 1 << int(size) % 16
            x, y = np.arange(columns, dtype=np.float32), np.arange(rows, dtype=np.float32)
            chosen = np.flatnonzero(sizes == size)
            for batch in np.array_split(chosen, len(chosen) * rows * columns // _BATCH + 1):
                covered = np.minimum.reduce(_grid(edges[:, batch], x, y)) >= 0.0
                member, row, column = np.nonzero(covered)
                face = batch[member]
                nearness = _grid(inverse_depth[batch], x, y)[covered]
                column, row = column + low[face, 0], row + low[face, 1]
                seen = (column < view.width) & (row < view.height) & (nearness > 0.0)
                pixel = (row * view.width + column)[seen]
                bits = nearness[seen].view(np.int32).astype(np.int64) << 32 | (face[seen] + first)
                np.maximum.at(self._nearest, pixel, bits)
                fragments.append((pixel, bits))
        return np.concatenate([pixel for pixel, _ in fragments]), np.concatenate([bits for _, bits in fragments])


def _grid(
    linear: npt.NDArray[np.float32], x: npt.NDArray[np.float32], y: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Values (..., rows, columns) of linear functions (..., 3) of the pixel: per column, per row, constant."""
    down = linear[..., 1:2] * y + linear[..., 2:]
    return (linear[..., 0:1] * x)[..., None, :] + down[..., None]


def _clip(corners: FloatArray, near: float) -> list[FloatArray]:
    """Return the part of a polygon (4, 3) beyond the near plane, as polygons (4, 3) (Sutherland and Hodgman 1974)."""
    kept: list[FloatArray] = []
    depth = corners[:, 2] - 1.001 * near
    for index, corner in enumerate(corners):
        here, before = depth[index], depth[index - 1]
        if (here > 0.0) != (before > 0.0):
            kept.append(corners[index - 1] + (corner - corners[index - 1]) * (before / (before - here)))
        if here > 0.0:
            kept.append(corner)
    if len(kept) < 3:
        return []
    fan = [np.array([kept[0], kept[1], kept[2], kept[min(3, len(kept) - 1)]])]
    return fan if len(kept) < 5 else [*fan, np.array([kept[0], kept[3], kept[4], kept[4]])]
