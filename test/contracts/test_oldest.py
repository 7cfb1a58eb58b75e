"""The chain with the oldest versions that setup.py allows; `make oldest`, a part of `make test`, runs it."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RESULT = ROOT / "build" / "oldest"


def test_a_village_becomes_the_same_models_with_the_oldest_versions():
    if not (RESULT / "score.json").exists():
        pytest.skip("run `make oldest` first; it needs Python 3.10 or 3.11")
    scores = {one["kind"]: one for one in json.loads((RESULT / "score.json").read_text())}
    assert scores["buildings"]["iou"] > 0.98
    counts = {scores["outlines"][name] for name in ("n_found", "n_reference", "n_result")}
    assert len(counts) == 1
    assert scores["outlines"]["mean_iou"] > 0.95
    run = json.loads((RESULT / "result" / "run.json").read_text())
    assert run["buildings"] == {"ok": 25}
    assert run["n_unclassified"] == 0


def test_the_oldest_versions_are_those_of_setup_py():
    wanted = dict(re.findall(r'"([a-z-]+)(?:\[\w+\])?>=([\w.]+)', (ROOT / "setup.py").read_text()))
    tried = dict(
        line.split("==")
        for line in (ROOT / "test" / "oldest_versions.txt").read_text().split()
        if "==" in line
    )
    assert tried.keys() <= wanted.keys()
    for name, version in tried.items():
        assert version.startswith(wanted[name]), f"{name}: setup.py allows {wanted[name]}"
