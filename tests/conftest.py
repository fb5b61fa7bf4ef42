"""Shared settings: the artifacts of this checkout, and property tests that say the same thing on every run."""

from __future__ import annotations

import os
from pathlib import Path

from hypothesis import settings

os.environ.setdefault("TINYSPLAT_MODELS", str(Path(__file__).resolve().parents[1] / "models"))

settings.register_profile("repeatable", derandomize=True, deadline=None, max_examples=40)
settings.load_profile("repeatable")
