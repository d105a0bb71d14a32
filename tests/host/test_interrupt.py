"""Ctrl-C while something is in hand."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator

import pytest

from axistwin.interrupt import Interrupts

BOTH = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])


@pytest.fixture(autouse=True)
def in_the_foreground() -> Iterator[None]:
    """SIGINT as Python takes it, though the tests may run in the background, which ignores it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@BOTH
def test_what_is_held_is_finished_first(number: signal.Signals) -> None:
    done = []

    def work(interrupts: Interrupts) -> None:
        with interrupts.held():
            os.kill(os.getpid(), number)
            done.append("in hand")
        done.append("next")

    with Interrupts().taken() as interrupts, pytest.raises(KeyboardInterrupt):
        work(interrupts)
    assert done == ["in hand"]


@BOTH
def test_elsewhere_it_interrupts_at_once(number: signal.Signals) -> None:
    with Interrupts().taken() as interrupts:
        with interrupts.held():
            pass
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
        with interrupts.held():
            pass  # nothing is left over


def test_an_error_inside_is_not_hidden_by_it() -> None:
    def work(interrupts: Interrupts) -> None:
        with interrupts.held():
            os.kill(os.getpid(), signal.SIGINT)
            raise ValueError("inside")

    with Interrupts().taken() as interrupts, pytest.raises(ValueError, match="inside"):
        work(interrupts)


def test_afterwards_everything_is_as_it_was() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with Interrupts().taken():
        assert signal.getsignal(signal.SIGINT) != before[0]
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_a_signal_that_is_ignored_stays_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with Interrupts().taken():
            os.kill(os.getpid(), signal.SIGINT)
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_thread_that_gets_no_signals_asks_for_none() -> None:
    failures: list[BaseException] = []

    def other() -> None:
        try:
            with Interrupts().taken() as interrupts, interrupts.held():
                pass
        except BaseException as error:  # which would be lost with the thread
            failures.append(error)

    thread = threading.Thread(target=other)
    thread.start()
    thread.join()
    assert failures == []
