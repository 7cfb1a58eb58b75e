"""Attributes of buildings under the names that other data sets have for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

#: The names of this package alone.
OWN = "own"
#: What the parameter `attributes` may be → the columns that it adds.
OTHER_NAMES: dict[str, dict[str, type]] = {
    OWN: {},
    # https://docs.3dbag.nl/en/schema/attributes, release 2024 and later
    "3dbag": {
        "identificatie": str, "b3_h_maaiveld": float, "b3_h_dak_min": float, "b3_h_dak_50p": float,
        "b3_h_dak_70p": float, "b3_h_dak_max": float, "b3_dak_type": str, "b3_opp_grond": float,
        "b3_opp_dak_plat": float, "b3_opp_dak_schuin": float, "b3_n_vlakken": int, "b3_volume_lod22": float,
        "b3_rmse_lod22": float, "b3_val3dity_lod22": str,
    },
}  # fmt: skip
#: 3DBAG's names of what is the same here.
_SAME = {
    "b3_h_maaiveld": "ground_elevation", "b3_h_dak_min": "roof_elevation_min",
    "b3_h_dak_50p": "roof_elevation_50p", "b3_h_dak_70p": "roof_elevation_70p",
    "b3_h_dak_max": "roof_elevation_max", "b3_opp_grond": "area",
}  # fmt: skip
_FINEST = {"b3_volume_lod22": "volume", "b3_rmse_lod22": "rmse"}
_LOD22 = "2.2"
#: A face less steep is horizontal to 3DBAG's reconstruction [degrees].
_HORIZONTAL = 5.0
_DECIMALS = 4


def other_attributes(
    names: str, attributes: dict[str, Any], readable_id: str, faces: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """
    Return what a building's attributes are by other names, in the same units; None where unknown.

    `faces` are those of its finest roof.
    """
    if names == OWN:
        return {}
    known: dict[str, Any] = dict.fromkeys(OTHER_NAMES[names])
    known["identificatie"] = attributes.get("footprint_id") or readable_id
    known |= {name: attributes.get(own) for name, own in _SAME.items()}
    level = [one["area"] for one in faces if one["slope_deg"] < _HORIZONTAL]
    sloped = [one["area"] for one in faces if one["slope_deg"] >= _HORIZONTAL]
    if (attributes.get("lod") or "") < _LOD22:
        return known | {"b3_dak_type": "could not detect" if attributes.get("n_points") else "no points"}
    flat = "single horizontal" if len(level) == 1 else "multiple horizontal"
    return known | {
        "b3_dak_type": "slanted" if sloped else flat,
        "b3_opp_dak_plat": round(sum(level), _DECIMALS),
        "b3_opp_dak_schuin": round(sum(sloped), _DECIMALS),
        "b3_n_vlakken": len(faces),
        "b3_val3dity_lod22": "[]",
        **({n: attributes.get(own) for n, own in _FINEST.items()} if attributes["lod"] == _LOD22 else {}),
    }
