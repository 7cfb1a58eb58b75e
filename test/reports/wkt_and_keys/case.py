from support.cloud_files import random_cloud, saved, with_geo_keys, with_wkt
from support.report_cases import Case


def case(folder, house):
    cloud = with_geo_keys(with_wkt(random_cloud(point_format=6), "EPSG:32631"), {1024: 1, 3072: 28992})
    path = saved(cloud, folder / "both.laz")
    says = [
        "is in EPSG:32631 (unit metre) by its WKT, in EPSG:28992 (unit metre) by its GeoTIFF keys: taking"
    ]
    return Case(["inspect", path], says=[*says, "system   EPSG:28992"])
