"""A W&B service without a network: the part of the `wandb` package's public API that is used."""

import base64
import hashlib
import threading
import types
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO


class CommError(Exception):
    """As wandb has it: an answer that is an error."""


@dataclass
class File:
    name: str
    data: bytes
    service: "Service"
    torn: bool = False

    @property
    def size(self) -> int:
        return len(self.data)

    @property
    def md5(self) -> str:
        return base64.b64encode(hashlib.md5(self.data).digest()).decode()

    def download(self, root: str, replace: bool) -> IO[str]:
        assert replace
        self.service.downloads.append(self.name)
        path = Path(root) / self.name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(self.data[: len(self.data) // 2] if self.torn else self.data)
        return path.open()


@dataclass
class Artifact:
    inside: list[File]

    def files(self) -> list[File]:
        return self.inside


@dataclass
class Run:
    inside: list[File]
    artifacts: list[Artifact] = field(default_factory=list)

    def files(self) -> list[File]:
        return self.inside

    def logged_artifacts(self) -> list[Artifact]:
        return self.artifacts


class Service:
    """Runs by path; `fails` is raised, and `hangs` waits, when the service is asked."""

    def __init__(self) -> None:
        self.runs: dict[str, Run] = {}
        self.downloads: list[str] = []
        self.fails: Exception | None = None
        self.hangs = False
        self.released = threading.Event()

    def add(self, path: str, *names: str) -> Run:
        self.runs[path] = Run([File(name, f"model {name}".encode() * 10, self) for name in names])
        return self.runs[path]

    def module(self) -> types.ModuleType:
        service = self

        class Api:
            def __init__(self, timeout: int) -> None:
                assert timeout >= 1

            def run(self, path: str) -> Run:
                if service.hangs:
                    service.released.wait(20.0)
                if service.fails is not None:
                    raise service.fails
                if path not in service.runs:
                    raise CommError(f"Could not find run <Run {path} (not found)>")
                return service.runs[path]

        module = types.ModuleType("wandb")
        module.Api = Api  # type: ignore[attr-defined]
        return module
