"""
The virtual roofs of `test/model_scenes.py`, which are found whether or not the tests are on the path.

"""

from __future__ import annotations

import sys

from clouds import ROOT

sys.path.insert(0, str(ROOT / "test"))
try:
    from model_scenes import BAD_SCENES, SHAPES, ModelScene, model_scene, roof_words
finally:
    sys.path.pop(0)

__all__ = ["BAD_SCENES", "SHAPES", "ModelScene", "model_scene", "roof_words"]
