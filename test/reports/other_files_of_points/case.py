from support.report_cases import Case


def case(folder, house):
    names = ["a.e57", "a.xyz", "ept.json"]
    for name in names:
        (folder / name).write_text("none")
    says = [f"{name}: is " for name in names] + [
        "E57",
        "points as text",
        "EPT",
        "`pdal translate",
    ]
    return Case(["inspect", *(folder / name for name in names)], status=2, says=says, n_lines=len(names))
