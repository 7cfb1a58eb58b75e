from support.report_cases import Case, rewritten


def case(folder, house):
    def emptied(cloud):
        for name in ("gps_time", "return_number", "number_of_returns", "point_source_id"):
            cloud[name][:] = 0

    path = rewritten(house / "strip_01.laz", folder / "empty.laz", emptied)
    says = ["GPS times are all 0", "return numbers are all 0", "point source ids are all 0"]
    return Case(["inspect", path], says=says)
