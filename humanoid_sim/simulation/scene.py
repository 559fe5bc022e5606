"""The room around a robot: floor, light, sky, and where pictures look from.

Only the floor touches the robot's dynamics, and only a robot that has none of its own gets one.
"""

from __future__ import annotations

import mujoco
import numpy as np

from humanoid_sim.robots.description import RobotDescription

_FLOOR = "scene_floor"


def add_floor(spec: mujoco.MjSpec, bare: mujoco.MjModel, description: RobotDescription, *, material: str = "") -> None:
    """Add a floor to a robot that brings none; `bare` is the spec compiled.

    Whatever can collide at all collides with it, whichever bits its contact masks use.
    """
    # A robot could stand on a plane, on a height field, and on anything else fixed that extends a metre all around.
    is_ground = np.isin(bare.geom_type, (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)))
    is_fixed = bare.body_weldid[bare.geom_bodyid] == 0
    can_collide = (bare.geom_contype != 0) | (bare.geom_conaffinity != 0)
    is_wide = (bare.geom_aabb.reshape(-1, 6)[:, 3:5] >= 1.0).all(axis=1)
    if (is_ground | (is_fixed & can_collide & is_wide)).any():
        return
    spec.worldbody.add_geom(
        name="floor" if spec.geom("floor") is None else "",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 0.05],
        pos=[0.0, 0.0, description.simulation.floor_height],
        material=material,
        contype=1 | int(np.bitwise_or.reduce(bare.geom_conaffinity)),
        conaffinity=1 | int(np.bitwise_or.reduce(bare.geom_contype)),
    )


def add_scene(spec: mujoco.MjSpec, bare: mujoco.MjModel, description: RobotDescription) -> None:
    """Add the room to a robot's spec; `bare` is the same compiled, without a room."""
    visual = spec.visual
    visual.global_.offwidth, visual.global_.offheight = 1920, 1440  # px, of the largest picture
    visual.global_.azimuth, visual.global_.elevation = 155.0, -14.0  # degrees: the face of a robot that looks along +x
    visual.quality.shadowsize = 2048  # on a processor, twice as fast as MuJoCo's own
    visual.map.shadowclip = 12.0  # extents; near the rim of a smaller shadow map the floor speckles
    visual.headlight.ambient = [0.34, 0.34, 0.36]
    _add_texture(spec, "scene_sky", mujoco.mjtTexture.mjTEXTURE_SKYBOX, [0.44, 0.55, 0.68], [0.86, 0.90, 0.94])
    _add_texture(spec, _FLOOR, mujoco.mjtTexture.mjTEXTURE_2D, [0.66, 0.69, 0.72], [0.61, 0.64, 0.67])
    textures = [""] * int(mujoco.mjtTextureRole.mjNTEXROLE)
    textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = _FLOOR
    spec.add_material(name=_FLOOR, textures=textures, texrepeat=[2.0, 2.0], texuniform=True)
    add_floor(spec, bare, description, material=_FLOOR)
    spec.worldbody.add_light(
        name="scene_light",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=bare.stat.center + bare.stat.extent * np.array([1.2, 1.0, 2.4]),
        dir=[-0.42, -0.35, -0.84],
        diffuse=[0.55] * 3,
        castshadow=True,
    )


def _add_texture(
    spec: mujoco.MjSpec, name: str, kind: mujoco.mjtTexture, first: list[float], second: list[float]
) -> None:
    is_sky = kind == mujoco.mjtTexture.mjTEXTURE_SKYBOX
    builtin = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT if is_sky else mujoco.mjtBuiltin.mjBUILTIN_CHECKER
    height = 6 * 256 if is_sky else 256
    spec.add_texture(name=name, type=kind, builtin=builtin, rgb1=first, rgb2=second, width=256, height=height)
