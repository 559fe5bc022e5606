import mujoco
import numpy as np
import pytest

from humanoid_sim.rendering.polygons import tessellate

EMPTY = mujoco.MjModel.from_xml_string("<mujoco/>")
GEOM = mujoco.mjtGeom


def enclosed_volume(mesh):
    """By the divergence theorem; negative if the faces turn inward."""
    vertices, faces = mesh
    a, b, c, d = (vertices[faces[:, corner]] for corner in range(4))
    return float((np.cross(a, b) * c).sum() + (np.cross(a, c) * d).sum()) / 6


@pytest.mark.parametrize(
    ("kind", "size", "volume"),
    [
        (GEOM.mjGEOM_BOX, (0.1, 0.2, 0.3), 8 * 0.1 * 0.2 * 0.3),
        (GEOM.mjGEOM_SPHERE, (0.1, 0.1, 0.1), 4 / 3 * np.pi * 0.1**3),
        (GEOM.mjGEOM_ELLIPSOID, (0.1, 0.2, 0.3), 4 / 3 * np.pi * 0.1 * 0.2 * 0.3),
        (GEOM.mjGEOM_CYLINDER, (0.1, 0.1, 0.3), np.pi * 0.1**2 * 0.6),
        (GEOM.mjGEOM_CAPSULE, (0.1, 0.1, 0.3), np.pi * 0.1**2 * 0.6 + 4 / 3 * np.pi * 0.1**3),
    ],
)
@pytest.mark.parametrize("cell", [0.02, np.inf])
def test_faces_turn_outward_and_enclose_the_volume(kind, size, volume, cell):
    mesh = tessellate(EMPTY, kind, size, cell=cell)
    assert mesh is not None
    assert enclosed_volume(mesh) == pytest.approx(volume, rel=0.12 if cell == np.inf else 0.03)


def test_planes_have_no_polygons_of_their_own():
    assert tessellate(EMPTY, GEOM.mjGEOM_PLANE, (0.0, 0.0, 1.0)) is None


@pytest.mark.parametrize("rings", [6, 60])
def test_meshes_keep_their_shape_when_they_are_simplified(rings):
    angles = np.linspace(0, np.pi, rings)
    around = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    polar, turn = np.meshgrid(angles[1:-1], around, indexing="ij")
    points = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1) * 0.1
    text = " ".join(
        f"{value:.6f}" for value in np.concatenate([points.reshape(-1, 3), [[0, 0, 0.1], [0, 0, -0.1]]]).ravel()
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="ball" vertex="{text}"/></asset>'
        '<worldbody><geom type="mesh" mesh="ball"/></worldbody></mujoco>'
    )
    mesh = tessellate(model, GEOM.mjGEOM_MESH, (0.1, 0.1, 0.1), mesh=0)
    assert len(mesh[1]) < 5000
    assert (len(mesh[1]) < model.nmeshface) == (rings == 60)
    assert enclosed_volume(mesh) == pytest.approx(4 / 3 * np.pi * 0.1**3, rel=0.25 if rings == 6 else 0.05)
