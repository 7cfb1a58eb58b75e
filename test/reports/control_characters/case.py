from support.report_cases import Case


def case(folder, house):
    path = folder / "two\nlines\x1b[31m.laz"
    path.write_text("no cloud")
    return Case(["inspect", path], status=2, says=[r"two\nlines\x1b[31m.laz: is "], n_lines=1)
