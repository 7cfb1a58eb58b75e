import laspy
from support.cloud_files import random_cloud, saved
from support.report_cases import Case, run_of


def case(folder, house):
    cloud = random_cloud(2000, point_format=4)
    cloud.header.global_encoding.waveform_data_packets_external = True
    path = saved(cloud, folder / "wave.las")

    def check():
        after = laspy.read(folder / "out" / "classified" / "wave.laz")
        assert after.header.point_format.id == 1
        assert not after.header.global_encoding.waveform_data_packets_external

    says = ["its waveforms are in another file: the classified cloud refers to none"]
    return Case(run_of(folder, path), says=says, check=check)
