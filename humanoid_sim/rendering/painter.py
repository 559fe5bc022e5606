"""Draws MuJoCo's scene without OpenGL, on NumPy and Pillow: flat-shaded polygons, a ground, soft shadows.

It takes its geoms and its camera from `mujoco.MjvScene`, as the OpenGL renderer does, so both show the same things
from the same place. Of the lights it takes the direction of one; textures are reduced to their colours, and what is
partly transparent is paler instead.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageChops, ImageDraw, ImageFilter

from humanoid_sim.mit import FloatArray
from humanoid_sim.rendering.polygons import DepthBuffer, Mesh, View, tessellate

_SKY, _HORIZON = np.array([0.60, 0.71, 0.83]), np.array([0.90, 0.93, 0.95])
_SUN = np.array([0.42, 0.35, 0.84])
"""Unit vector towards the light where the model has none, world frame: above, in front and to the left."""
_AMBIENT, _KEY, _HEADLIGHT = 0.36, 0.46, 0.26
_SHADOW, _SHADOW_OPACITY = (51, 59, 71), 110
_SHADOW_SIDES = 16
_SUPERSAMPLING = 2
"""Pixels that are drawn for each of the picture, in each direction."""
_TILE = 0.25
"""m, side of the squares on the ground."""
_CELLS = 90
"""Polygons are about this much smaller than the model."""
_VISIBLE = 0.05
"""Geoms with less alpha are left out."""
GHOST, GHOST_OPACITY = (0.10, 0.62, 0.92), 0.55
"""Colour of a second pose of the robot, and how much of what is behind it that hides."""
_GHOST_BEHIND = 0.004
"""Part of the model's size by which a ghost is drawn farther away: where it agrees with the robot it is not seen."""
_KEPT = 16
"""Sets of geoms whose polygons are kept: the robot's, and those of its ghost that are not where the robot's are."""
_OUTLINE = 0.45
"""Brightness of an outline, of what it lies on."""

Picture = npt.NDArray[np.uint8]


class Painter:
    """A software renderer for one model, camera and picture size."""

    backend = "software painter"

    def __init__(
        self, model: mujoco.MjModel, width: int, height: int, camera: mujoco.MjvCamera, *, outlined: bool = False
    ) -> None:
        """Prepare; geoms that are `outlined` are set off from each other by a dark line."""
        self._model, self._camera = model, camera
        self._width, self._height = width * _SUPERSAMPLING, height * _SUPERSAMPLING
        self._option = mujoco.MjvOption()
        self._scene, self._ghost_scene = mujoco.MjvScene(model, 2000), mujoco.MjvScene(model, 2000)
        self._meshes: dict[tuple[Any, ...], Mesh | None] = {}
        self._solids: dict[tuple[tuple[Any, ...], ...], _Solids] = {}
        self._ground: tuple[bytes, _Ground] | None = None
        self._outlined = outlined

    def render(self, data: mujoco.MjData, ghost: mujoco.MjData | None = None) -> Picture:
        """Return the picture of the poses in `data`, shape (height, width, 3), RGB. What is not finite is not drawn.

        `ghost` is another pose of the model, shown through it in one colour, as far as its bodies can move.
        """
        geoms = self._seen(data, self._scene)
        view = View(self._scene, self._width, self._height)
        planes = [geom for geom in geoms if geom.type == mujoco.mjtGeom.mjGEOM_PLANE]
        solids, world, colours = self._place([geom for geom in geoms if geom.type != mujoco.mjtGeom.mjGEOM_PLANE])
        ground, sun = self._ground_of(view, planes), _sun(self._scene)

        image = ground.image.copy()
        if planes and len(world):
            image.paste(_SHADOW, mask=_shadows(view, planes[0], world, solids.first_vertex, sun, ground.lit))
        spectre = None
        if ghost is not None:
            spectre = self._place(self._departed(geoms, self._seen(ghost, self._ghost_scene)))[:2]
        part = _extent(view, world if spectre is None else np.concatenate([world, spectre[1]]))
        near, depth = view.crop(*part), ground.depth.crop(*part)
        left, top, right, bottom = (side // _SUPERSAMPLING for side in part)
        picture = np.array(
            image.crop((left, top, right, bottom)).resize((near.width, near.height), Image.Resampling.NEAREST)
        )
        first = depth.count
        faces, shade = _shaded(near, world[solids.faces], sun)
        depth.draw(faces, (colours[solids.face_geom] * shade[:, None])[shade > 0.0], picture)
        if self._outlined:
            owner = np.concatenate([[-1], solids.face_geom[shade > 0.0]])
            _outline(picture, owner[np.maximum(depth.numbers() - first + 1, 0)])
        if spectre is not None:
            self._haunt(picture, near, depth, *spectre)
        image.paste(Image.fromarray(picture).reduce(_SUPERSAMPLING), (left, top))
        return np.asarray(image)

    def _seen(self, data: mujoco.MjData, scene: mujoco.MjvScene) -> list[Any]:
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, data, self._option, None, self._camera, every, scene)
        return [
            geom
            for geom in scene.geoms[: scene.ngeom]
            if geom.rgba[3] > _VISIBLE and np.isfinite(geom.pos).all() and np.isfinite(geom.mat).all()
        ]

    def _departed(self, geoms: list[Any], ghosts: list[Any]) -> list[Any]:
        """Those of a ghost's geoms that are not where the robot's are, by more than what could be seen."""
        near = _GHOST_BEHIND * self._model.stat.extent
        placed = {geom.objid: geom for geom in geoms if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM}
        found = []
        for geom in ghosts:
            own = placed.get(geom.objid) if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM else None
            if own is None or geom.type == mujoco.mjtGeom.mjGEOM_PLANE:
                continue
            turned = np.abs(geom.mat - own.mat).max() * self._model.geom_rbound[geom.objid]
            if np.abs(geom.pos - own.pos).max() + turned > near:
                found.append(geom)
        return found

    def _haunt(self, picture: Picture, view: View, depth: DepthBuffer, solids: _Solids, world: FloatArray) -> None:
        """Blend a ghost into a picture: where it is nearest, by more than what separates two poses that agree."""
        faces, shade = _shaded(view, world[solids.faces])
        faces = faces + np.array([0.0, 0.0, _GHOST_BEHIND * self._model.stat.extent])
        shown = picture.copy()
        depth.draw(faces, (np.array(GHOST) * np.clip(shade, 0.6, 1.0)[:, None])[shade > 0.0], shown)
        changed = (shown != picture).any(axis=-1)
        blended = GHOST_OPACITY * shown[changed] + (1.0 - GHOST_OPACITY) * picture[changed]
        picture[changed] = blended.astype(np.uint8)

    def close(self) -> None:
        """Nothing is held that needs releasing."""

    def _place(self, geoms: list[Any]) -> tuple[_Solids, FloatArray, FloatArray]:
        """Return what has a surface, its vertices (V, 3) in m, world frame, and the colours of its geoms (G, 3)."""
        key = tuple((geom.type, *geom.size.tolist(), geom.dataid) for geom in geoms)
        if key not in self._solids:
            for shape in set(key) - self._meshes.keys():
                kind, *size, mesh = shape
                cell = self._model.stat.extent / _CELLS
                self._meshes[shape] = tessellate(self._model, kind, size, mesh // 2 if mesh >= 0 else -1, cell)
            if len(self._solids) >= _KEPT:
                self._solids.clear()
            self._solids[key] = _Solids([mesh for mesh in map(self._meshes.get, key) if mesh is not None])
        solids = self._solids[key]
        drawn = [geom for geom, shape in zip(geoms, key, strict=True) if self._meshes[shape] is not None]
        rotation = np.array([geom.mat for geom in drawn], dtype=np.float64).reshape(-1, 3, 3)[solids.vertex_geom]
        position = np.array([geom.pos for geom in drawn], dtype=np.float64).reshape(-1, 3)[solids.vertex_geom]
        world = np.einsum("vij,vj->vi", rotation, solids.vertices) + position
        return solids, world, np.array([_colours(self._model, geom)[0] for geom in drawn]).reshape(-1, 3)

    def _ground_of(self, view: View, planes: list[Any]) -> _Ground:
        """Sky and planes; drawn again only when the camera or a plane has moved."""
        parts = [view.eye, view.axes, *(part for geom in planes for part in (geom.pos, geom.mat, geom.rgba))]
        key = b"".join(part.tobytes() for part in parts)
        if self._ground is None or self._ground[0] != key:
            reach = 2.0 * float(np.linalg.norm(self._camera.lookat - view.eye) or self._model.stat.extent)
            self._ground = key, _Ground(self._model, view, planes, reach)
        return self._ground[1]


def _extent(view: View, world: FloatArray) -> tuple[int, int, int, int]:
    """Left, top, right and bottom pixel of the part of the picture that points (V, 3) can cover."""
    size, step = np.array([view.width, view.height]), _SUPERSAMPLING
    seen = view.to_camera(world)
    if not len(seen) or (seen[:, 2] <= view.near).any():
        return 0, 0, view.width, view.height
    pixels = view.to_pixels(seen)
    low = np.clip(np.floor(pixels.min(axis=0) / step - 1) * step, 0, size - step).astype(int)
    high = np.clip(np.ceil(pixels.max(axis=0) / step + 1) * step, low + step, size).astype(int)
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def _outline(picture: Picture, owner: npt.NDArray[np.intp]) -> None:
    """Darken the pixels at which another geom begins: `owner` (height, width) is the geom of each, -1 for none."""
    edge = np.zeros(owner.shape, dtype=np.bool_)
    for axis in (0, 1):
        differs = np.diff(owner, axis=axis) != 0
        edge[tuple(slice(None, -1) if i == axis else slice(None) for i in (0, 1))] |= differs
        edge[tuple(slice(1, None) if i == axis else slice(None) for i in (0, 1))] |= differs
    picture[edge] = (picture[edge] * _OUTLINE).astype(np.uint8)


class _Solids:
    """The vertices and faces of several meshes, joined."""

    def __init__(self, meshes: list[Mesh]) -> None:
        counts = [len(vertices) for vertices, _ in meshes]
        self.first_vertex = np.cumsum([0, *counts])[:-1]
        self.vertices = np.concatenate([np.empty((0, 3)), *(vertices for vertices, _ in meshes)])
        self.vertex_geom = np.repeat(np.arange(len(meshes)), counts)
        shifted = [faces + first for (_, faces), first in zip(meshes, self.first_vertex, strict=True)]
        self.faces = np.concatenate([np.empty((0, 4), dtype=np.intp), *shifted])
        self.face_geom = np.repeat(np.arange(len(meshes)), [len(faces) for faces in shifted])


class _Ground:
    """Sky and planes: their picture and (mode L) how clearly shadows show on it, both in final size; their depth."""

    def __init__(self, model: mujoco.MjModel, view: View, planes: list[Any], reach: float) -> None:
        horizon = view.height / 2 - view.focal * np.tan(np.arcsin(np.clip(-view.axes[2, 2], -1.0, 1.0)))
        rows = np.clip(np.arange(view.height) / max(horizon, 1.0), 0.0, 1.0)[:, None]
        column = (255 * (_SKY + (_HORIZON - _SKY) * rows)).astype(np.uint8)
        picture = np.repeat(column[:, None], view.width, axis=1)
        lit = np.zeros_like(picture)
        self.depth = DepthBuffer(view)
        for geom in planes:
            tiles, colours, strength = _tiles(model, geom, view, reach)
            faces, shade = _shaded(view, tiles)
            before = self.depth.copy()
            self.depth.draw(faces, colours[shade > 0.0], picture)
            before.draw(faces, np.repeat(strength[shade > 0.0, None], 3, axis=1), lit)
        self.image = Image.fromarray(picture).reduce(_SUPERSAMPLING)
        self.lit = Image.fromarray(lit[..., 0]).reduce(_SUPERSAMPLING)


def _sun(scene: mujoco.MjvScene) -> FloatArray:
    """Towards the model's first light that shines from above, world frame, unit length."""
    for light in scene.lights[: scene.nlight]:
        if not light.headlight and light.dir[2] < -0.3:
            towards = -np.asarray(light.dir, dtype=np.float64)
            return towards / np.linalg.norm(towards)
    return _SUN


def _shaded(view: View, faces: FloatArray, sun: FloatArray = _SUN) -> tuple[FloatArray, FloatArray]:
    """Return the faces (f, 4, 3) towards the eye, camera frame, and the brightness (F,) of all: 0 for the others."""
    normal = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
    towards = view.eye - faces.mean(axis=1)
    scale = np.sqrt(np.einsum("fi,fi->f", normal, normal) * np.einsum("fi,fi->f", towards, towards))
    head = np.einsum("fi,fi->f", normal, towards) / np.maximum(scale, 1e-12)
    key = normal @ sun / np.maximum(np.sqrt(np.einsum("fi,fi->f", normal, normal)), 1e-12)
    brightness = np.where(head > 1e-6, _AMBIENT + _KEY * np.maximum(key, 0.0) + _HEADLIGHT * head, 0.0)
    return view.to_camera(faces[brightness > 0.0]), brightness


def _shadows(
    view: View, plane: Any, world: FloatArray, first_vertex: npt.NDArray[np.intp], sun: FloatArray, lit: Image.Image
) -> Image.Image:
    """Return what the light leaves dark on a plane, softened, as clearly as `lit` says: one convex outline per geom."""
    axes = plane.mat.astype(np.float64)
    away = world - plane.pos
    height = np.maximum(away @ axes[:, 2], 0.0)
    fallen = (away - (height / max(axes[:, 2] @ sun, 0.2))[:, None] * sun) @ axes[:, :2]
    # A convex set is the intersection of its supporting half-planes; the outline turns where neighbours cross.
    step = 2 * np.pi / _SHADOW_SIDES
    angle = np.arange(_SHADOW_SIDES) * step
    reach = np.maximum.reduceat(fallen @ [np.cos(angle), np.sin(angle)], first_vertex)
    along = (np.roll(reach, -1, axis=1) - reach * np.cos(step)) / np.sin(step)
    u, v = reach * np.cos(angle) - along * np.sin(angle), reach * np.sin(angle) + along * np.cos(angle)
    corners = view.to_camera(u[..., None] * axes[:, 0] + v[..., None] * axes[:, 1] + plane.pos)
    outlines = view.to_pixels(corners[(corners[..., 2] > view.near).all(axis=1)]) * (lit.width / view.width)
    coarse = Image.new("L", (max(lit.width // 2, 1), max(lit.height // 2, 1)))  # what is soft needs no more
    draw = ImageDraw.Draw(coarse)
    for outline in (outlines / 2).reshape(len(outlines), -1).tolist():
        draw.polygon(outline, fill=_SHADOW_OPACITY)
    soft = coarse.filter(ImageFilter.GaussianBlur(lit.height / 160))
    return ImageChops.multiply(soft.resize(lit.size, Image.Resampling.BILINEAR), lit)


def _tiles(model: mujoco.MjModel, plane: Any, view: View, reach: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Squares (F, 4, 3) of a plane, their colours (F, 3), and how clearly each is seen (F,).

    A plane without end is drawn for `reach` metres around the point that is looked at, and fades into the horizon.
    """
    axes, origin = plane.mat.astype(np.float64), plane.pos.astype(np.float64)
    middle = np.round((view.eye + view.axes[2] * reach / 2 - origin) @ axes[:, :2] / _TILE) * _TILE
    endless = plane.size[:2] <= 0.0
    low = np.where(endless, middle - reach, -plane.size[:2])
    high = np.where(endless, middle + reach, plane.size[:2])
    count = np.clip(np.round((high - low) / max(_TILE, reach / 40)), 1, 80).astype(int)
    cuts = [np.linspace(low[axis], high[axis], count[axis] + 1) for axis in (0, 1)]
    u, v = np.meshgrid(*cuts, indexing="ij")
    points = u[..., None] * axes[:, 0] + v[..., None] * axes[:, 1] + origin
    tiles = np.stack([points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    odd = np.add.outer(np.arange(count[0]), np.arange(count[1])).ravel() % 2
    away = np.linalg.norm((tiles.mean(axis=1) - origin) @ axes[:, :2] - middle, axis=1) / reach
    strength = np.clip(1.25 - 1.25 * away, 0.0, 1.0) ** 1.5 if endless.any() else np.ones(len(tiles))
    return tiles, _HORIZON + (_colours(model, plane)[odd] - _HORIZON) * strength[:, None], strength


def _colours(model: mujoco.MjModel, geom: Any) -> FloatArray:
    """Two colours (2, 3) of a geom: those of its checkered texture, else its own twice, a plane's second one darker."""
    alpha = float(geom.rgba[3])
    pair = np.repeat(np.array(geom.rgba[None, :3], dtype=np.float64), 2, axis=0)
    texture = -1 if geom.matid < 0 else model.mat_texid[geom.matid, mujoco.mjtTextureRole.mjTEXROLE_RGB]
    if texture >= 0 and model.tex_nchannel[texture] >= 3:
        height, width, channels = (int(a[texture]) for a in (model.tex_height, model.tex_width, model.tex_nchannel))
        start = model.tex_adr[texture]
        pixels = model.tex_data[start : start + height * width * channels].reshape(height, width, channels)
        pair *= pixels[height // 4, [width // 4, 3 * width // 4], :3] / 255.0
    elif geom.type == mujoco.mjtGeom.mjGEOM_PLANE:
        pair[1] *= 0.93
    return pair * alpha + _HORIZON * (1.0 - alpha)
