from humanoid_sim.errors import known_names


def test_a_message():
    assert known_names("joint", "elbw", ["elbow", "wrist"]) == (
        "unknown joint 'elbw' (did you mean 'elbow'?); known: elbow, wrist"
    )
    assert known_names("joint", "x", ["elbow"]) == "unknown joint 'x'; known: elbow"
    assert known_names("joint", "x", []) == "unknown joint 'x'; known: none"
