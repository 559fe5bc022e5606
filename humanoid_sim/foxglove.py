"""A live server for Foxglove: the topics of the recording, and a service that damps.

Any page in a browser on this machine can reach the server: WebSockets know no same-origin rule, and it asks nobody for
a name. So it only shows, and damps; `--control` is for whoever knows that.
"""

from __future__ import annotations

import json
import queue
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from humanoid_sim.cli import run_program
from humanoid_sim.client import Intake, Looks, SessionError, SessionInfo
from humanoid_sim.command_line import parse
from humanoid_sim.errors import InputError
from humanoid_sim.frontends import require_packages
from humanoid_sim.frontends.attach import Attachment, attached, behind, ready
from humanoid_sim.recording.codec import decode_event
from humanoid_sim.recording.recorder import EVENT_TOPIC, TICK_TOPIC
from humanoid_sim.recording.topics import TopicMessage, ViewerTopics
from humanoid_sim.ros2.definitions import EVENT, SCHEMA_ENCODING, TICK, schema_text
from humanoid_sim.ros2.topics import kind_of

_HOST = "127.0.0.1"
_PAUSE = 0.01
"""s between two looks at the feed, which holds many more ticks than come meanwhile."""
_LOOK_PERIOD = 0.5
"""s between two looks whether the session stands still."""
_BACKLOG = 256
"""Messages that wait for one client; of a slow one the oldest are dropped."""
_CONTROL = ("load_a", "load_b", "start_locomotion", "start_remote", "quit")
_LATE = "late"
"""Id of the status that says so."""


@dataclass(frozen=True)
class FoxgloveConfig:
    """Serve a running session's topics to Foxglove, on this machine alone, and a service /damp."""

    session: int | None = None
    """Process id of the session. Default: the only one that runs."""
    port: int = 8765
    """TCP port on 127.0.0.1; 0 for one that is free."""
    control: bool = False
    """Offer services for all intents: every page open in a browser on this machine can then move the robot."""

    EXAMPLES: ClassVar[tuple[tuple[str, str], ...]] = (("", "open ws://localhost:8765 in Foxglove"),)


def service_words(control: bool) -> tuple[str, ...]:
    """Return the intents that are offered as services; `control`: all of them."""
    return ("damp", *_CONTROL) if control else ("damp",)


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until the session ends; returns the exit status."""
    config = parse(FoxgloveConfig, "foxglove", arguments)
    if not 0 <= config.port <= 65535:
        raise InputError(f"--port: is {config.port}, expected 0 to 65535")
    require_packages("foxglove")
    with attached(config.session, "foxglove") as attachment:
        server = _Server(attachment, config)
        try:
            ready(f"open a connection to ws://{_HOST}:{server.port}, for {attachment.session}")
            if config.control:
                ready("WARNING: every page open in a browser on this machine can move the robot (control is on)")
            server.run()
        finally:
            server.close()
    return 0


class _Server:
    """Its handlers run on threads of the library's."""

    def __init__(self, attachment: Attachment, config: FoxgloveConfig) -> None:
        """Listen. Raises `InputError` if the port cannot be had."""
        import foxglove  # noqa: PLC0415 - an extra
        from foxglove.websocket import ServerListener  # noqa: PLC0415

        subscribed: queue.SimpleQueue[str] = queue.SimpleQueue()

        class Listener(ServerListener):  # type: ignore[misc]
            def on_subscribe(self, client: Any, channel: Any) -> None:
                subscribed.put(channel.topic)

        self._library, self._subscribed = foxglove, subscribed
        self._attachment, self._header = attachment, attachment.header
        self._topics = ViewerTopics(self._header)
        self._channels: dict[str, Any] = {}
        self._last: dict[str, tuple[bytes, int]] = {}
        """Message of each latched topic, and its time in ns."""
        self._is_late = False
        self._looks = Looks()
        self._context = foxglove.Context()
        listener = Listener()
        try:
            self._server = foxglove.start_server(
                name=f"humanoid_sim {attachment.session.robot} ({attachment.session.process})",
                host=_HOST,
                port=config.port,
                services=[self._service(word) for word in service_words(config.control)],
                supported_encodings=["json"],
                server_listener=listener,
                context=self._context,
                message_backlog_size=_BACKLOG,
            )
        except (RuntimeError, OSError) as error:
            raise InputError(f"--port: {config.port} on {_HOST} cannot be had: {error}") from None
        self.port = int(self._server.port)

    def close(self) -> None:
        """Stop listening."""
        self._server.stop()

    def run(self) -> None:
        """Publish until the session ends."""
        feed = self._attachment.feed
        newest, event, looked = feed.latest(), 0, time.monotonic()
        for samples in self._attachment.looks(self._attachment.before_present(), _PAUSE):
            self._looks.look()
            for sample in samples:
                newest = sample
                if self._attachment.follow():
                    self._topics.follow(self._attachment.header)
                record = self._attachment.record(sample)
                time_ns = self._attachment.time_ns(float(record.input.state.time))
                self._publish(TopicMessage(TICK_TOPIC, TICK, sample.data), time_ns)
                for message in self._topics.messages(record, time_ns):
                    self._publish(message, time_ns)
            for sample in feed.since(event, "event"):
                event = sample.number
                time_ns = self._attachment.time_ns(decode_event(sample.data).time)
                self._publish(TopicMessage(EVENT_TOPIC, EVENT, sample.data), time_ns)
            self._repeat_latched()
            if time.monotonic() - looked > _LOOK_PERIOD:
                looked = time.monotonic()
                self._say("" if newest is None else behind(newest.age(), feed.control_period))

    def _publish(self, message: TopicMessage, time_ns: int) -> None:
        channel = self._channels.get(message.topic)
        if channel is None:
            schema = self._library.Schema(
                name=message.schema, encoding=SCHEMA_ENCODING, data=schema_text(message.schema).encode()
            )
            channel = self._channels[message.topic] = self._library.Channel(
                message.topic, schema=schema, message_encoding="cdr", context=self._context
            )
        if kind_of(message.topic, message.schema).latched:
            self._last[message.topic] = message.data, time_ns
        channel.log(message.data, log_time=time_ns)

    def _repeat_latched(self) -> None:
        """For those who have just subscribed."""
        topics = set()
        while not self._subscribed.empty():
            topics.add(self._subscribed.get())
        for topic in topics & self._last.keys():
            data, time_ns = self._last[topic]
            self._channels[topic].log(data, log_time=time_ns)

    def _say(self, late: str) -> None:
        if late:
            self._server.publish_status(f"session: {late}", self._library.StatusLevel.Warning, _LATE)
        elif self._is_late:
            self._server.remove_status([_LATE])
        self._is_late = bool(late)

    def _service(self, word: str) -> Any:
        def schema(properties: dict[str, Any]) -> Any:
            document = json.dumps({"type": "object", "properties": properties}).encode()
            named = self._library.Schema(name="Trigger", encoding="jsonschema", data=document)
            return self._library.MessageSchema(encoding="json", schema=named)

        answer = {"success": {"type": "boolean"}, "message": {"type": "string"}}
        return self._library.Service(
            f"/{word}",
            schema=self._library.ServiceSchema("Trigger", request=schema({}), response=schema(answer)),
            handler=_asking(self._attachment.session, word, self._looks),
        )


def _asking(session: SessionInfo, word: str, looks: Looks) -> Callable[[Any], bytes]:
    """Return a service's handler. Each call has sockets of its own, so that none waits for another."""

    def handle(_: Any) -> bytes:
        try:
            with Intake(session, "foxglove") as intake:
                answer = intake.ask(word, seen=looks.called())
        except SessionError as error:
            return json.dumps({"success": False, "message": str(error)}).encode()
        return json.dumps({"success": answer.granted, "message": answer.text}).encode()

    return handle


if __name__ == "__main__":
    sys.exit(run_program(main))
