"""Options of the teleoperator, `--teleop.…`."""

from dataclasses import dataclass, field

from lerobot.teleoperators import TeleoperatorConfig


@TeleoperatorConfig.register_subclass("humanoid_sim")
@dataclass(kw_only=True)
class HumanoidSimTeleoperatorConfig(TeleoperatorConfig):
    """Hands led from the terminal's keyboard."""

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    hands: list[str] = field(default_factory=list)
    """The bodies that are led. Default: the hands in the robot's file."""
    step: float = 0.005
    """m for each press."""
    max_joint_speed: float = 2.0
    """rad/s at which the joints follow, at most."""
    keys: str = ""
    """Keys that are pressed in the place of the keyboard's, one every `key_period_s`; a dot presses none."""
    key_period_s: float = 0.04
    """s"""
