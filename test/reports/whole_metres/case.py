import json

import numpy as np
from support.report_cases import Case, rewritten, run_of


def case(folder, house):
    def rounded(cloud):
        cloud.xyz = np.round(cloud.xyz)

    path = rewritten(house / "strip_01.laz", folder / "whole.laz", rounded)

    def check():
        run = json.loads((folder / "out" / "run.json").read_text())
        assert "coarse_steps" in [one["code"] for one in run["remarks"]]
        assert "have steps of 1 m" in (folder / "out" / "report.html").read_text()

    return Case(run_of(folder, path), says=["x and y and z have steps of 1 m"], check=check)
