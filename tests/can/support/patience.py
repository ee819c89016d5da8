"""Transfers that a halt of this machine may abort: the device drops a silent client after 2 s, in a block after 1 s."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

import canopen

T = TypeVar("T")
# SdoServer::kTimeOutUs, halved in a block.
SERVER_WAITS_S = 1.0


def again_if_halted(transfer: Callable[[], T]) -> T:
    """The transfer's result; repeated if it was aborted after longer than the device waits for a client."""
    for _ in range(4):
        begin_s = time.monotonic()
        try:
            return transfer()
        except canopen.SdoAbortedError:
            if time.monotonic() - begin_s < SERVER_WAITS_S:
                raise
    return transfer()
