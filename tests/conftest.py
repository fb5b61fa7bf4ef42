"""Shared settings: the artifacts of this checkout, and property tests that say the same thing on every run."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from hypothesis import settings

os.environ.setdefault("TINYSPLAT_MODELS", str(Path(__file__).resolve().parents[1] / "models"))

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # a shell's background job: commands under test would inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=40)
settings.load_profile("repeatable")
