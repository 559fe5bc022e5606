"""The room around a robot: floor, lights, sky, cameras and render quality. None of it touches the robot's dynamics."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from humanoid_sim.mit import FloatArray
from humanoid_sim.robots.description import RobotDescription

__all__ = ["CAMERAS", "OFFSCREEN_SIZE", "add_scene"]

OFFSCREEN_SIZE = (1920, 1440)
"""px, width and height of the largest image that can be rendered off screen."""

CAMERAS = {"front": (30.0, 12.0), "side": (90.0, 8.0), "back": (205.0, 15.0), "top": (0.0, 80.0)}
"""Cameras that every scene has: azimuth (from the robot's front, towards its left) and elevation, degrees."""

_FLOORS = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)

_FIELD_OF_VIEW = 38.0
"""degrees, vertical: long enough a lens that a hand in front does not look bigger than the head."""


def add_scene(spec: mujoco.MjSpec, bare: mujoco.MjModel, description: RobotDescription) -> None:
    """Add the room to a robot's spec. What the robot's own MJCF brings (a floor, lights, cameras) is kept, not doubled.

    Args:
        spec: changed in place.
        bare: the same compiled, without a room.
        description: the robot; its base carries the cameras, if it moves.
    """
    center: FloatArray = bare.stat.center.copy()
    extent = float(bare.stat.extent)
    _add_sky_and_quality(spec)
    if not any(geom.type in _FLOORS for geom in spec.geoms):
        _add_floor(spec, description.simulation.floor_height)
    if not spec.lights:
        _add_lights(spec, center, extent)
    taken = {camera.name for camera in spec.cameras}
    for name, (azimuth, elevation) in CAMERAS.items():
        if name not in taken:
            _add_camera(spec, name, center, _viewing_distance(extent), math.radians(azimuth), math.radians(elevation))


def _viewing_distance(extent: float) -> float:
    """m, at which a sphere as large as the robot fills a 4:3 picture almost from side to side."""
    return 0.42 * extent / math.sin(math.radians(0.5 * _FIELD_OF_VIEW))


def _add_sky_and_quality(spec: mujoco.MjSpec) -> None:
    spec.visual.global_.offwidth, spec.visual.global_.offheight = OFFSCREEN_SIZE
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


def _add_floor(spec: mujoco.MjSpec, height: float) -> None:
    spec.add_texture(
        name="scene_floor",
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
    textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = "scene_floor"
    spec.add_material(name="scene_floor", textures=textures, texrepeat=[2.0, 2.0], texuniform=True)
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 0.05],
        pos=[0.0, 0.0, height],
        material="scene_floor",
        contype=1,
        conaffinity=1,
    )


def _add_lights(spec: mujoco.MjSpec, center: FloatArray, extent: float) -> None:
    """A key light from the front left, which casts shadows, and a weak fill from the right."""
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
    spec: mujoco.MjSpec, name: str, center: FloatArray, distance: float, azimuth: float, elevation: float
) -> None:
    """A camera that looks at `center`; angles in rad. MuJoCo's cameras look along their own -z, with +y up."""
    backward = np.array(
        [math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation)]
    )
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    rotation = np.column_stack([right, np.cross(backward, right), backward])
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, rotation.ravel())
    spec.worldbody.add_camera(name=name, pos=center + distance * backward, quat=quaternion, fovy=_FIELD_OF_VIEW)
