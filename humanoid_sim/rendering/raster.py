"""Perspective and a depth buffer in NumPy: which polygon is seen at each pixel.

The inverse of the depth of a plane is linear in the pixel's coordinates, and so is the side of an edge on which a pixel
lies. All polygons of about the same size on the picture are therefore drawn at once.
"""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from humanoid_sim.mit import FloatArray

__all__ = ["DepthBuffer", "View"]

_BATCH = 1 << 19
"""Samples that are worked on at once; bounds the memory."""


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
        self._count = 0

    def copy(self) -> DepthBuffer:
        """A buffer of its own, with what was drawn so far."""
        other = DepthBuffer.__new__(DepthBuffer)
        other._view, other._nearest, other._count = self._view, self._nearest.copy(), self._count
        return other

    def draw(self, faces: FloatArray, colours: FloatArray, picture: npt.NDArray[np.uint8]) -> None:
        """Draw convex polygons that turn towards the eye where nothing nearer was drawn.

        Args:
            faces: shape (F, 4, 3), m, camera frame, anticlockwise seen from the eye.
            colours: shape (F, 3), in 0 to 1.
            picture: shape (height, width, 3); written to.
        """
        whole = (faces[..., 2] > self._view.near).all(axis=1)
        cut = np.flatnonzero(~whole & (faces[..., 2] > self._view.near).any(axis=1))
        pieces = [(index, piece) for index in cut for piece in _clip(faces[index], self._view.near)]
        faces = np.concatenate([faces[whole], *(piece[None] for _, piece in pieces)])
        colours = np.concatenate([colours[whole], colours[[index for index, _ in pieces]]])
        pixel, bits = self._insert(faces, self._count)
        won = self._nearest[pixel] == bits
        shades = (255 * np.clip(colours, 0.0, 1.0)).astype(np.uint8)
        picture.reshape(-1, 3)[pixel[won]] = shades[(bits[won] & 0xFFFFFFFF) - self._count]
        self._count += len(faces)

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
    """The part of a polygon (4, 3) beyond the near plane, as polygons (4, 3) (Sutherland and Hodgman 1974)."""
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
