"""The room around a robot: floor, lights, sky, cameras and render quality.

Only the floor touches the robot's dynamics, and only a robot that has none of its own gets one.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription

_OFFSCREEN_SIZE = 1920, 1440  # px, of the largest image that can be rendered off screen
CAMERAS = {"front": (30.0, 12.0), "side": (90.0, 8.0), "back": (205.0, 15.0), "top": (0.0, 80.0)}
"""Cameras that every scene has: azimuth (from the robot's front, towards its left) and elevation, degrees."""
_FLOOR_MATERIAL = "scene_floor"
_VISIBLE_GROUPS = 0, 1, 2  # of geoms, that MuJoCo's viewers show by default
_FIELD_OF_VIEW = 38.0  # degrees, vertical: a hand in front does not look bigger than the head


def add_scene(spec: mujoco.MjSpec, bare: mujoco.MjModel, description: RobotDescription) -> None:
    """Add the room to a robot's spec. What the robot's own MJCF brings (a floor, lights, cameras) is kept, not doubled.

    `bare` is the same compiled, without a room. Cameras go along with a floating base, without turning with it.
    """
    center: FloatArray = bare.stat.center.copy()
    extent = float(bare.stat.extent)
    _add_sky_and_quality(spec)
    _show_colliders(spec)
    _add_floor_material(spec)
    for geom in spec.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE and not geom.material:
            geom.material = _FLOOR_MATERIAL  # on a plain floor nobody sees how far a robot has walked
    add_floor(spec, bare, description, material=_FLOOR_MATERIAL)
    if not spec.worldbody.lights:  # a lamp that a body carries lights no room
        _add_lights(spec, center, extent)
    taken = {camera.name for camera in spec.cameras}
    base = bare.body(description.base.body).id if description.is_floating else 0
    # m, at which a sphere as large as the robot fills a 4:3 picture almost from side to side. One that stands on its
    # legs is as high as that sphere, and needs room to sway.
    share = 0.60 if description.is_floating else 0.42
    distance = share * extent / math.sin(math.radians(0.5 * _FIELD_OF_VIEW))
    for name, (azimuth, elevation) in CAMERAS.items():
        if name not in taken:
            # Axes in columns: right, up and backward. MuJoCo's cameras look along their own -z, with +y up.
            turn, lift = math.radians(azimuth), math.radians(elevation)
            backward = np.array([math.cos(lift) * math.cos(turn), math.cos(lift) * math.sin(turn), math.sin(lift)])
            right = np.array([-math.sin(turn), math.cos(turn), 0.0])
            rotation = np.column_stack([right, np.cross(backward, right), backward])
            _add_camera(spec, name, bare, base, center + distance * rotation[:, 2], rotation)


def _add_sky_and_quality(spec: mujoco.MjSpec) -> None:
    spec.visual.global_.offwidth, spec.visual.global_.offheight = _OFFSCREEN_SIZE
    spec.visual.quality.shadowsize = 4096
    spec.visual.quality.offsamples = 4
    # The floor speckles with its own shadow near the rim of the shadow map: 12 extents away it is in the haze.
    spec.visual.map.shadowclip = 12.0
    spec.visual.headlight.ambient = [0.34, 0.34, 0.36]
    spec.visual.headlight.diffuse = [0.24, 0.24, 0.24]
    spec.visual.headlight.specular = [0.08, 0.08, 0.08]
    spec.visual.rgba.haze = [0.80, 0.85, 0.90, 1.0]
    if not any(texture.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX for texture in spec.textures):
        spec.add_texture(
            name="scene_sky",
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
            rgb1=[0.44, 0.55, 0.68],
            rgb2=[0.86, 0.90, 0.94],
            width=256,
            height=256 * 6,
        )


def _show_colliders(spec: mujoco.MjSpec) -> None:
    """Paint the colliders of a robot that has nothing else to look at, such as one whose meshes were left out."""
    shapes = [geom for body in spec.bodies for geom in body.geoms if body.name != "world"]
    if any(geom.group in _VISIBLE_GROUPS for geom in shapes):
        return
    for geom in shapes:
        geom.group = 0
        geom.rgba = [0.62, 0.65, 0.69, 1.0]


def _add_floor_material(spec: mujoco.MjSpec) -> None:
    spec.add_texture(
        name=_FLOOR_MATERIAL,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        mark=mujoco.mjtMark.mjMARK_EDGE,
        rgb1=[0.66, 0.69, 0.72],
        rgb2=[0.61, 0.64, 0.67],
        markrgb=[0.52, 0.55, 0.59],
        width=512,
        height=512,
    )
    textures = [""] * int(mujoco.mjtTextureRole.mjNTEXROLE)
    textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = _FLOOR_MATERIAL
    spec.add_material(name=_FLOOR_MATERIAL, textures=textures, texrepeat=[2.0, 2.0], texuniform=True)


def add_floor(spec: mujoco.MjSpec, bare: mujoco.MjModel, description: RobotDescription, *, material: str = "") -> None:
    """Add a floor to a robot that brings none, the only part of a room that dynamics know.

    Whatever can collide at all collides with it, whichever bits its contact masks use. `bare` is the spec compiled;
    without a material the floor is grey.
    """
    # A robot could stand on a plane, on a height field, and on anything else fixed that extends a metre all around.
    is_ground = np.isin(bare.geom_type, (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)))
    is_fixed = bare.body_weldid[bare.geom_bodyid] == 0
    can_collide = (bare.geom_contype != 0) | (bare.geom_conaffinity != 0)
    is_wide = (bare.geom_aabb.reshape(-1, 6)[:, 3:5] >= 1.0).all(axis=1)
    if (is_ground | (is_fixed & can_collide & is_wide)).any():
        return
    floor = {
        "name": "floor" if spec.geom("floor") is None else "",
        "pos": [0.0, 0.0, description.simulation.floor_height],
        "material": material,
        "contype": 1 | int(np.bitwise_or.reduce(bare.geom_conaffinity)),
        "conaffinity": 1 | int(np.bitwise_or.reduce(bare.geom_contype)),
    }
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 0.05], **floor)


def _add_lights(spec: mujoco.MjSpec, center: FloatArray, extent: float) -> None:
    """Add a key light from the front left, which casts shadows, and a weak fill from the right."""
    for name, offset, strength, shadow in (
        ("key", np.array([1.2, 1.0, 2.4]), 0.55, True),
        ("fill", np.array([0.9, -1.6, 1.2]), 0.22, False),
    ):
        spec.worldbody.add_light(
            name=f"scene_{name}",
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            pos=center + offset * extent,
            dir=-offset / math.sqrt(float(offset @ offset)),
            diffuse=[strength] * 3,
            specular=[0.3 * strength] * 3,
            castshadow=shadow,
        )


def _add_camera(
    spec: mujoco.MjSpec, name: str, bare: mujoco.MjModel, body: int, position: FloatArray, rotation: FloatArray
) -> None:
    """Add a camera at a pose of the world frame, fixed there (body 0), or keeping its distance from a body."""
    owner, mode = spec.worldbody, mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    if body:
        data = mujoco.MjData(bare)
        mujoco.mj_kinematics(bare, data)
        owner, mode = spec.body(bare.body(body).name), mujoco.mjtCamLight.mjCAMLIGHT_TRACK
        body_rotation = data.xmat[body].reshape(3, 3)
        position, rotation = body_rotation.T @ (position - data.xpos[body]), body_rotation.T @ rotation
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, rotation.ravel())
    owner.add_camera(name=name, pos=position, quat=quaternion, fovy=_FIELD_OF_VIEW, mode=mode)
