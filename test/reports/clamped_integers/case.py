import struct

from support.report_cases import Case, rewritten, run_of


def case(folder, house):
    def clamped(cloud):
        cloud.Y[:] = -(2**31)

    path = rewritten(house / "strip_01.laz", folder / "clamped.las", clamped)
    with open(path, "r+b") as file:  # the bounds are the ones that were meant
        file.seek(195)
        file.write(struct.pack("<2d", 5_427_300.0, 5_427_200.0))
    says = ["y is the same at all points, the limit of the file's integers"]
    return Case(run_of(folder, path), status=2, says=says, n_lines=1)
