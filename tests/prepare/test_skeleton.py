from humanoid_sim.prepare.skeleton import Skeleton
from humanoid_sim.robots.description import load_robot


def test_orders_of_the_lite():
    skeleton = Skeleton(load_robot("lite"))
    assert skeleton.base == skeleton.bodies[0] == "chest"
    assert skeleton.joint_orders["robot"] == skeleton.joint_orders["mjcf"] == load_robot("lite").joint_names
    assert skeleton.joint_orders["breadth_first"][:4] == (
        "left_shoulder_pitch",
        "right_shoulder_pitch",
        "left_shoulder_roll",
        "right_shoulder_roll",
    )
    breadth_first = skeleton.body_orders["breadth_first"]
    assert breadth_first[:4] == ("chest", "left_shoulder_pitch", "right_shoulder_pitch", "neck_yaw")
    assert sorted(breadth_first) == sorted(skeleton.bodies)
