"""The modes as ROS 2 services, on this machine only: `python -m humanoid_sim.ros2_services`.

For the Python of a ROS 2 installation, 3.9 or later: this needs `rclpy`, `std_srvs`, the standard library, and
`client.py`. The two files work without the package, side by side in any folder: `python ros2_services.py`.

A service changes a mode, so none may be reached from another machine. The middleware is configured for the loopback
interface before it starts, its sockets are bound to that device, and where either fails there is no node.
"""

from __future__ import annotations

import os
import sys
import tempfile
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or __package__:
    from humanoid_sim.client import (
        Answer,
        Looks,
        SessionError,
        SessionInfo,
        ask_sessions,
        find_session,
        network_on,
    )
else:
    from client import Looks, SessionError, ask_sessions, find_session, network_on

_WORDS = ("damp", "load_a", "load_b", "start_remote", "start_locomotion", "quit")
SERVICES = {f"/humanoid_control/mode/{word}": word for word in _WORDS}
"""Names, and what each asks the session for."""
LOOPBACK = "lo"
LARGEST_DOMAIN = 232
"""Beyond it there are no UDP ports for one (DDSI-RTPS 2.5, 9.6.2)."""

_FAST_DDS = """\
<?xml version="1.0" encoding="UTF-8"?>
<dds><profiles xmlns="http://www.eprosima.com">
 <transport_descriptors>
  <transport_descriptor>
   <transport_id>loopback</transport_id><type>UDPv4</type>
   <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>
  </transport_descriptor>
  <transport_descriptor><transport_id>memory</transport_id><type>SHM</type></transport_descriptor>
 </transport_descriptors>
 <participant profile_name="this_machine" is_default_profile="true"><rtps>
  <userTransports><transport_id>loopback</transport_id><transport_id>memory</transport_id></userTransports>
  <useBuiltinTransports>false</useBuiltinTransports>
 </rtps></participant>
</profiles></dds>
"""
"""Settings of the discovery range (`ROS_AUTOMATIC_DISCOVERY_RANGE`, `ROS_LOCALHOST_ONLY`) let discovery out; this does
not, and clients with default settings find it."""
_PROFILES_VARIABLES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")
_FAST_DDS_2 = ("foxy", "galactic", "humble", "iron", "jazzy")
"""Distributions with Fast DDS 2, which knows the second variable."""
_CYCLONE_DDS = (
    '<CycloneDDS><Domain id="any"><General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces>'
    "<AllowMulticast>spdp</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    '<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>'
    "</Domain></CycloneDDS>"
)
_ELSEWHERE = (
    "FASTDDS_BUILTIN_TRANSPORTS",
    "FASTDDS_ENVIRONMENT_FILE",
    "ROS_DISCOVERY_SERVER",
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
    "ROS_SUPER_CLIENT",
)
"""Variables that would have the middleware look for others in places of their own."""

_DAMPS_AT_ONCE = 4
"""Threads that only a damp ever takes."""
_TURN = 0.05
"""s that the executor waits for at most, so that a program that was suspended notices it (`Looks`)."""
_LOOK = 10
"""Turns between two looks at whether the session goes on."""

_HELP = """\
Serve the modes of a running session as ROS 2 services of the type std_srvs/srv/Trigger:

  /humanoid_control/mode/{damp,load_a,load_b,start_remote,start_locomotion,quit}

success says whether the intent was granted, message what became of it, or why it was refused. damp
goes to all sessions that run. Without --session it serves whichever session runs when it is called, and goes on when
that one ends. Only programs on this machine can reach it. ROS_DOMAIN_ID is the domain.
"""


class ServiceError(Exception):
    """There can be no services; one line."""


def loopback_environment(middleware: str, profiles: Path) -> Mapping[str, str | None]:
    """Get the environment variables with which a middleware stays on this machine; None for those that must not be set.

    Raises `ServiceError` if it is one that cannot be restricted.

    Args:
        profiles: a file that is written here where the middleware reads one.
    """
    variables: dict[str, str | None] = {**dict.fromkeys(_ELSEWHERE), "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    if middleware.startswith("rmw_fastrtps"):
        profiles.write_text(_FAST_DDS, encoding="utf-8")
        is_old = os.environ.get("ROS_DISTRO", "") in _FAST_DDS_2
        current, other = _PROFILES_VARIABLES[::-1] if is_old else _PROFILES_VARIABLES
        variables.update({current: str(profiles), other: None})
        return {**variables, "SKIP_DEFAULT_XML_FILE": "1"}  # one of the working folder
    if middleware.startswith("rmw_cyclonedds"):
        return {**variables, "CYCLONEDDS_URI": _CYCLONE_DDS}
    raise ServiceError(
        f"RMW_IMPLEMENTATION: {middleware or 'none'} cannot be kept on this machine, expected rmw_fastrtps_cpp or "
        "rmw_cyclonedds_cpp"
    )


def answer(word: str, process: int | None, seen: int | None = None) -> tuple[bool, str]:
    """Return what a session makes of an intent: whether it is granted, and the text that says so, or why not.

    Args:
        process: id of the session; None for the only one that runs, and all of them for `damp`.
        seen: ns, since when it may have been asked for; None: now.
    """
    answers: list[tuple[SessionInfo, Answer | SessionError]] = []
    try:
        answers += ask_sessions(word, process, producer="ROS 2 service", seen=seen)
    except SessionError as error:
        return False, str(error)
    if len(answers) == 1 and not isinstance(answers[0][1], SessionError):
        return answers[0][1].granted, answers[0][1].text
    texts = [str(told) if isinstance(told, SessionError) else f"{session}: {told.text}" for session, told in answers]
    return all(not isinstance(told, SessionError) and told.granted for _, told in answers), "; ".join(texts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until a signal, or the end of the session that was asked for; returns the exit status."""
    parser = ArgumentParser(
        "python -m humanoid_sim.ros2_services", description=_HELP, formatter_class=RawDescriptionHelpFormatter
    )
    parser.add_argument("--session", type=int, help="process id of the session; default: the only one that runs")
    config = parser.parse_args(arguments)
    try:
        if config.session is not None:
            find_session(config.session)
        with tempfile.TemporaryDirectory(prefix="humanoid_sim-") as folder:
            _serve(config, Path(folder) / "fastdds.xml")
    except (ServiceError, SessionError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _serve(config: Namespace, profiles: Path) -> None:
    """Run a node on this machine until a signal, or the end of the session that was asked for."""
    try:
        import rclpy  # noqa: PLC0415 - a user's own; whoever lacks it is told in a line
        from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor  # noqa: PLC0415
        from rclpy.utilities import get_rmw_implementation_identifier  # noqa: PLC0415
    except ImportError as error:
        raise _missing(error) from None
    _confine(get_rmw_implementation_identifier(), profiles)
    try:
        rclpy.init(args=[])
    except RuntimeError as error:  # of rclpy
        raise ServiceError(f"ROS 2 does not start: {str(error).splitlines()[0]}") from None
    looks = Looks()
    try:
        # Five services, which run one at a time each, and damps, which wait for none of them.
        executor = MultiThreadedExecutor(num_threads=len(SERVICES) + _DAMPS_AT_ONCE)
        try:
            with network_on(LOOPBACK):
                node = rclpy.create_node("mode_services", start_parameter_services=False)
                serves = _advertise(node, config, looks)
        except ImportError as error:
            raise _missing(error) from None
        except OSError as error:
            raise ServiceError(f"the sockets of ROS 2 cannot be bound to the device {LOOPBACK}: {error}") from None
        executor.add_node(node)
        print(f"{serves} on this machine, domain {node.context.get_domain_id()}", flush=True)
        try:
            for turn in count():
                if not rclpy.ok() or not (config.session is None or turn % _LOOK or find_session(config.session)):
                    break
                looks.look()
                executor.spin_once(timeout_sec=_TURN)
        except (KeyboardInterrupt, ExternalShutdownException, SessionError):
            pass
    finally:
        rclpy.try_shutdown()


def _confine(middleware: str, profiles: Path) -> None:
    """Keep the middleware on this machine. Raises `ServiceError` if it cannot be, or for a domain that is none."""
    for variable, value in loopback_environment(middleware, profiles).items():
        if value is None:
            os.environ.pop(variable, None)
        else:
            os.environ[variable] = value
    domain = os.environ.get("ROS_DOMAIN_ID", "") or "0"
    if not (domain.isascii() and domain.isdigit() and int(domain) <= LARGEST_DOMAIN):  # Fast DDS would exit
        raise ServiceError(f"ROS_DOMAIN_ID: is '{domain}', expected a whole number from 0 to {LARGEST_DOMAIN}")


def _missing(error: ImportError) -> ServiceError:
    return ServiceError(
        f"the services need ROS 2's Python ({error}): source /opt/ros/<distribution>/setup.bash and run them there"
    )


def _advertise(node: Any, config: Namespace, looks: Looks) -> str:
    """Give the node its services; returns a line that says which."""
    from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup  # noqa: PLC0415
    from std_srvs.srv import Trigger  # noqa: PLC0415

    def respond(word: str, response: Any) -> Any:
        response.success, response.message = answer(word, config.session, looks.called())
        return response

    for name, word in SERVICES.items():
        group = ReentrantCallbackGroup() if word == "damp" else MutuallyExclusiveCallbackGroup()
        node.create_service(Trigger, name, lambda _, response, word=word: respond(word, response), callback_group=group)

    return f"services {', '.join(SERVICES)}"


if __name__ == "__main__":
    sys.exit(main())
