from support.bags import MOUNTED, placed, with_profile, write_drive
from support.report_cases import Case


def case(folder, house):
    bag = write_drive(folder / "bag").path
    (file,) = bag.glob("*.mcap")
    single = with_profile(file, "")
    single = single.rename(folder / single.name)
    meta = bag / "metadata.yaml"
    meta.write_text(meta.read_text().replace("storage_identifier: mcap", 'storage_identifier: ""'))

    def check():
        for path in (single, bag):
            _, count = placed(folder, path, MOUNTED)
            assert (count.n_points, count.warnings) == (5000, [])

    return Case(
        ["inspect", single, bag], says=["/points: sensor_msgs/msg/PointCloud2, 10 messages"], check=check
    )
