from play_fixtures import folder, make_robot, quick, run

__all__ = ["folder", "make_robot", "quick", "run"]
