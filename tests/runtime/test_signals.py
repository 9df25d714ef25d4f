"""Signals: they become stop requests, and the earlier handlers are restored."""

from __future__ import annotations

import os
import signal

import pytest

from bt_dualarm.runtime.interruption import StopRequest, stop_on_signals


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_signal_becomes_a_request_with_its_exit_code(number: int, code: int) -> None:
    before = signal.getsignal(number)
    with stop_on_signals(StopRequest()) as request:
        assert (request.asked, request.exit_code) == (False, 0)
        os.kill(os.getpid(), number)
        assert (request.asked, request.urgent, request.exit_code) == (True, False, code)
    assert signal.getsignal(number) is before


def test_the_second_signal_is_urgent_and_the_first_decides_the_code() -> None:
    with stop_on_signals(StopRequest()) as request:
        os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGINT)
    assert request.urgent
    assert request.exit_code == 143
