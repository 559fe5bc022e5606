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
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING or __package__:
    from humanoid_sim.client import SessionError, ask_sessions, find_session, monotonic_ns, network_on
else:
    from client import SessionError, ask_sessions, find_session, monotonic_ns, network_on

_WORDS = ("damp", "load_a", "load_b", "start_remote", "start_locomotion", "quit")
SERVICES = {f"/humanoid_control/mode/{word}": word for word in _WORDS}
"""Names, and the words that they send to the session."""
_DAMPS_AT_ONCE = 4  # threads that only a damp ever takes
_TURN = 0.05  # s that the executor waits for at most: what it finds came after the turn before

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
_FAST_DDS_2 = ("foxy", "galactic", "humble", "iron", "jazzy")  # distributions that know the second variable
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
_HELP = """\
Serve the modes of a running session as ROS 2 services of the type std_srvs/srv/Trigger:

  /humanoid_control/mode/{damp,load_a,load_b,start_remote,start_locomotion,quit}

success says whether the intent was granted, message what became of it, or why it was refused. damp
goes to all sessions that run. Only programs on this machine can reach it. ROS_DOMAIN_ID is the domain.
"""


class ServiceError(Exception):
    """There can be no services; one line."""


def loopback_environment(middleware: str, profiles: Path) -> Mapping[str, str | None]:
    """Return the environment variables with which a middleware stays on this machine; None for those to unset.

    `profiles` is a file that is written where the middleware reads one. Raises `ServiceError` if it cannot be
    restricted.
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
    """Return whether an intent is granted, and the text that says so, or why not.

    Args:
        process: id of the session; None for the only one that runs, and all of them for `damp`.
        seen: ns, since when it may have been requested; None: now.
    """
    granted, texts = True, []
    try:
        for session, reply in ask_sessions(word, process, producer="ROS 2 service", seen=seen):
            if isinstance(reply, SessionError):
                granted = False
                texts.append((session, str(reply)))
            else:
                granted = granted and reply.granted
                texts.append((session, reply.text))
    except SessionError as error:
        return False, str(error)
    return granted, texts[0][1] if len(texts) == 1 else "; ".join(f"{session}: {text}" for session, text in texts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until a signal, or the end of the session that is named; returns the exit status."""
    parser = ArgumentParser(
        "python -m humanoid_sim.ros2_services", description=_HELP, formatter_class=RawDescriptionHelpFormatter
    )
    parser.add_argument("--session", type=int, help="process id of the session; default: the only one that runs")
    session = parser.parse_args(arguments).session
    try:
        if session is not None:
            find_session(session)
        with tempfile.TemporaryDirectory(prefix="humanoid_sim-") as folder:
            _serve(session, Path(folder) / "fastdds.xml")
    except ImportError as error:
        print(
            f"error: the services need ROS 2's Python ({error}): source /opt/ros/<distribution>/setup.bash and run "
            "them there",
            file=sys.stderr,
        )
        return 2
    except (ServiceError, SessionError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _serve(session: int | None, profiles: Path) -> None:
    """Run a node on this machine until a signal, or the end of the session that is named."""
    import rclpy  # noqa: PLC0415 - a user's own
    from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor  # noqa: PLC0415
    from rclpy.utilities import get_rmw_implementation_identifier  # noqa: PLC0415

    for variable, value in loopback_environment(get_rmw_implementation_identifier(), profiles).items():
        os.environ.pop(variable, None)
        if value is not None:
            os.environ[variable] = value
    domain = os.environ.get("ROS_DOMAIN_ID", "") or "0"
    if not (domain.isascii() and domain.isdigit() and int(domain) <= 232):  # Fast DDS would exit
        raise ServiceError(f"ROS_DOMAIN_ID: is '{domain}', expected a whole number from 0 to 232")
    try:
        rclpy.init(args=[])
        with network_on("lo"):
            node = rclpy.create_node("mode_services", start_parameter_services=False)
            turns = _Turns(node, session)
    except RuntimeError as error:  # of rclpy
        raise ServiceError(f"ROS 2 does not start: {str(error).splitlines()[0]}") from None
    except OSError as error:
        raise ServiceError(f"the sockets of ROS 2 cannot be bound to the device lo: {error}") from None
    # Five services, which run one at a time each, and damps, which wait for none of them.
    executor = MultiThreadedExecutor(num_threads=len(SERVICES) + _DAMPS_AT_ONCE)
    executor.add_node(node)
    print(f"services {', '.join(SERVICES)} on this machine, domain {node.context.get_domain_id()}", flush=True)
    try:
        while rclpy.ok() and (session is None or find_session(session)):
            turns.begun = monotonic_ns()
            executor.spin_once(timeout_sec=_TURN)
    except (KeyboardInterrupt, ExternalShutdownException, SessionError):
        pass
    finally:
        rclpy.try_shutdown()


class _Turns:
    """Services of a node; what they are called for is as old as the turn in which the executor finds it."""

    def __init__(self, node: Any, session: int | None) -> None:
        from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup  # noqa: PLC0415
        from std_srvs.srv import Trigger  # noqa: PLC0415

        self.begun, self._session = monotonic_ns(), session
        for name, word in SERVICES.items():
            group = ReentrantCallbackGroup() if word == "damp" else MutuallyExclusiveCallbackGroup()
            respond = lambda _, response, word=word: self._respond(word, response)  # noqa: E731
            node.create_service(Trigger, name, respond, callback_group=group)

    def _respond(self, word: str, response: Any) -> Any:
        response.success, response.message = answer(word, self._session, self.begun)
        return response


if __name__ == "__main__":
    sys.exit(main())
