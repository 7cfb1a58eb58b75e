import laspy
from support.report_cases import Case, rewritten, run_of

from lidar_buildings.cli import main
from lidar_buildings.commands import run_local


def case(folder, house):
    inputs = folder / "in"
    inputs.mkdir()
    for k, name in enumerate("ab"):

        def moved(cloud, shift=1000.0 * k):
            cloud.x = cloud.x + shift

        rewritten(house / "strip_01.laz", inputs / f"{name}.laz", moved)
    original, away = run_local.OutputFolder, folder / "away"

    def opened(*arguments, **keywords):
        (inputs / "b.laz").rename(away)
        return original(*arguments, **keywords)

    def check():
        run_local.OutputFolder = original
        away.rename(inputs / "b.laz")
        assert main([*map(str, run_of(folder, inputs)), "--quiet"]) == 0
        assert (laspy.read(folder / "out" / "classified" / "b.laz").classification > 0).all()

    run_local.OutputFolder = opened
    return Case(run_of(folder, inputs), status=2, says=["the run is not finished: repeat"], check=check)
