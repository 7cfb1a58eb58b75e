"""
The scenes of `test/outline_scenes.py`, which are found whether or not the tests are on the path.

"""

from __future__ import annotations

import sys

from clouds import ROOT

sys.path.insert(0, str(ROOT / "test"))
try:
    from outline_scenes import PLANS, ROTATIONS, OutlineScene, outline_scene, outline_scenes
finally:
    sys.path.pop(0)

__all__ = ["PLANS", "ROTATIONS", "OutlineScene", "outline_scene", "outline_scenes"]
