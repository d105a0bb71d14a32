"""Hardware in the loop: a node, emulated or firmware, and the host against it on each carrier.

pytest --carriers=vcan tests/hil      in tests/tools/with-vcan, which provides the interface
pytest --carriers=pty,tcp tests/hil   anywhere
"""

from __future__ import annotations

import argparse
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from axistwin import bus
from axistwin.cli import main

from .carriers import CARRIERS, LACKS, Carrier


def pytest_addoption(parser: pytest.Parser) -> None:
    """Which carriers to run on: not every place has all of them."""
    parser.addoption(
        "--carriers",
        type=lambda text: text.split(","),
        default=list(CARRIERS),
        metavar="NAME,...",
        help=f"carriers to test on (default: {','.join(CARRIERS)})",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Declares the mark `needs`."""
    config.addinivalue_line("markers", "needs(what, ...): see tests/hil/carriers.py")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """A test is there once for each carrier that has what it needs."""
    if "carrier" in metafunc.fixturenames:
        needs = {need for mark in metafunc.definition.iter_markers("needs") for need in mark.args}
        names = [name for name in CARRIERS if not needs & LACKS[name].keys()]
        assert names, f"no carrier has all of {needs}"
        metafunc.parametrize("carrier", names, indirect=True)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leaves out the carriers that were not asked for."""
    chosen = config.getoption("carriers")

    def is_chosen(item: pytest.Item) -> bool:
        callspec = getattr(item, "callspec", None)
        return callspec is None or callspec.params.get("carrier", chosen[0]) in chosen

    config.hook.pytest_deselected(items=[item for item in items if not is_chosen(item)])
    items[:] = filter(is_chosen, items)


@dataclass(frozen=True)
class Outcome:
    """What a command said, and its exit status."""

    status: int
    output: str
    messages: str

    def expect(self, status: int, *words: str) -> None:
        """Checks the exit status, that the words were said, and that nothing crashed."""
        assert self.status == status, self.messages
        for word in words:
            assert word in self.messages
        assert "Traceback" not in self.messages


Host = Callable[..., Outcome]


@pytest.fixture
def carrier(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Carrier]:
    """Each carrier in turn that has what the test needs."""
    with CARRIERS[request.param](tmp_path) as opened:
        yield opened


@contextmanager
def connected(carrier: Carrier) -> Iterator[bus.Node]:
    """The host's connection to the node on a carrier."""
    parser = argparse.ArgumentParser()
    bus.add_arguments(parser)
    with bus.node_of(parser.parse_args(carrier.host)) as node:
        node.connect(10.0, lambda _: None)
        yield node


def pages(carrier: Carrier) -> dict[str, float]:
    """What the node on a carrier says of itself."""
    with connected(carrier) as node:
        assert node.wait_until(lambda: "HostHeartbeat" in node.pages, 10.0)  # the last of them
        return dict(node.pages)


def wait_until(condition: Callable[[], bool], patience: float = 60.0) -> None:
    """Waits for what another program does."""
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


@contextmanager
def during(log: Path, action: Callable[[], object]) -> Iterator[None]:
    """While a log is written to a file: does this, and ends the log then as Ctrl-C does."""
    over = threading.Event()

    def act() -> None:
        try:
            wait_until(lambda: log.exists() and log.stat().st_size > 5000)
            action()
        finally:
            if not over.is_set():
                os.kill(os.getpid(), signal.SIGINT)

    actor = threading.Thread(target=act)
    actor.start()
    try:
        yield
    finally:
        over.set()
        actor.join()


@pytest.fixture
def host(capfd: pytest.CaptureFixture[str]) -> Host:
    """Runs a command line of the host, in this process."""

    def run(*arguments: str) -> Outcome:
        capfd.readouterr()
        try:
            status = main(arguments)
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 1
        captured = capfd.readouterr()
        return Outcome(status, captured.out, captured.err)

    return run
