"""
The figures of a score as an aligned plain-text table.

"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

#: Figure → (label in the table, unit); a share has the unit "".
LABELS: dict[str, tuple[str, str]] = {
    "n_points": ("points", "n"),
    "n_ground": ("ground in the reference", "n"),
    "n_object": ("object in the reference", "n"),
    "n_ground_rejected": ("ground taken for object", "n"),
    "n_object_accepted": ("object taken for ground", "n"),
    "total_error": ("total error", ""),
    "type_1_error": ("type I error (ground rejected)", ""),
    "type_2_error": ("type II error (object accepted)", ""),
    "kappa": ("Cohen's kappa", ""),
    "alpha": ("radius of the alpha shapes' discs", "m"),
    "spacing": ("point spacing of the roofs", "m"),
    "n_roofs": ("roofs", "n"),
    "n_unlabelled": ("roof points without a label", "n"),
    "n_edges_reference": ("edge points in the reference", "n"),
    "n_edges_result": ("edge points in the result", "n"),
    "edge_completeness": ("edges: completeness", ""),
    "edge_correctness": ("edges: correctness", ""),
    "edge_f_score": ("edges: F-score", ""),
    "non_edge_completeness": ("other points: completeness", ""),
    "non_edge_correctness": ("other points: correctness", ""),
    "non_edge_f_score": ("other points: F-score", ""),
    "n_models": ("buildings in the result", "n"),
    "lod_22_share": ("share with LoD2.2", ""),
    "lod_13_share": ("share with LoD1.3 at most", ""),
    "lod_12_share": ("share with LoD1.2 at most", ""),
    "n_solids": ("solids of all levels", "n"),
    "valid_share": ("share of valid solids", ""),
    "n_models_reference": ("buildings in the reference", "n"),
    "n_matched": ("matched (IoU of footprints ≥ 0.5)", "n"),
    "height_covered": ("share of the reference's roofs covered", ""),
    "height_bias": ("roof elevation: mean difference", "m"),
    "height_rmse": ("roof elevation: RMSE", "m"),
    "height_percentile_95": ("roof elevation: 95 %", "m"),
    "height_largest": ("roof elevation: largest", "m"),
    "volume_ratio": ("volume: result / reference", "mean"),
    "volume_error_median": ("volume error of those matched, median", ""),
    "volume_error_largest": ("volume error of those matched, largest", ""),
    "ridge_n_reference": ("ridges in the reference", "n"),
    "ridge_recall": ("ridges: recall", ""),
    "ridge_bias": ("ridges: elevation, mean difference", "m"),
    "ridge_rmse": ("ridges: elevation, RMSE", "m"),
    "ridge_largest": ("ridges: elevation, largest difference", "m"),
    "roof_tolerance": ("roof corners and edges: tolerance", "m"),
    "roof_n_corners_result": ("roof corners in the result", "n"),
    "roof_n_corners_reference": ("roof corners in the reference", "n"),
    "roof_corner_precision": ("roof corners: precision", ""),
    "roof_corner_recall": ("roof corners: recall", ""),
    "roof_corner_f1": ("roof corners: F1", ""),
    "roof_corner_offset": ("roof corners: distance of those matched, mean", "m"),
    "roof_n_edges_result": ("roof edges in the result", "n"),
    "roof_n_edges_reference": ("roof edges in the reference", "n"),
    "roof_edge_precision": ("roof edges: precision", ""),
    "roof_edge_recall": ("roof edges: recall", ""),
    "roof_edge_f1": ("roof edges: F1", ""),
    "roof_edge_length_precision": ("roof edges: precision, by length", ""),
    "roof_edge_length_recall": ("roof edges: recall, by length", ""),
    "solid_vertices_result": ("vertices of a matched solid", "mean"),
    "solid_vertices_reference": ("vertices of its reference", "mean"),
    "solid_corners_result": ("corners of a matched solid", "mean"),
    "solid_corners_reference": ("corners of its reference", "mean"),
    "solid_roof_faces_result": ("roof faces of a matched solid", "mean"),
    "solid_roof_faces_reference": ("roof faces of its reference", "mean"),
    "solid_same_corners": ("share with as many corners", ""),
    "same_roof_type": ("share with the same roof type", ""),
    "n_roof_points": ("roof points", "n"),
    "point_uncovered": ("share under no roof", ""),
    "point_median": ("distance to the roof, median", "m"),
    "point_bias": ("distance to the roof, mean with sign", "m"),
    "point_rmse": ("distance to the roof, RMSE", "m"),
    "point_within_10_cm": ("share within 0.1 m", ""),
    "point_within_20_cm": ("share within 0.2 m", ""),
    "point_within_50_cm": ("share within 0.5 m", ""),
    "n_buildings_with_points": ("buildings with points", "n"),
    "building_rmse_median": ("RMSE of the buildings, median", "m"),
    "building_rmse_95": ("RMSE of the buildings, 95 %", "m"),
    "point_building_rmse_median": ("RMSE of the buildings, median", "m"),
    "point_building_rmse_95": ("RMSE of the buildings, 95 %", "m"),
    "cell": ("cell size", "m"),
    "n_result_cells": ("cells in the result", "n"),
    "n_reference_cells": ("cells in the reference", "n"),
    "n_common_cells": ("cells in both", "n"),
    "recall": ("recall (completeness)", ""),
    "precision": ("precision (correctness)", ""),
    "iou": ("IoU (quality)", ""),
    "point_recall": ("recall, by points", ""),
    "point_precision": ("precision, by points", ""),
    "point_f1": ("F1, by points", ""),
    "point_iou": ("IoU, by points", ""),
    "n_result": ("outlines in the result", "n"),
    "n_reference": ("outlines in the reference", "n"),
    "n_found": ("found (IoU ≥ 0.5)", "n"),
    "n_missed": ("missed", "n"),
    "n_extra": ("extra", "n"),
    "completeness": ("completeness, by objects", ""),
    "correctness": ("correctness, by objects", ""),
    "f1": ("F1, by objects", ""),
    "n_buildings": ("buildings in the reference", "n"),
    "n_covered": ("reference buildings covered (≥ 50 %)", "n"),
    "covered_share": ("share of reference buildings covered", ""),
    "mean_iou": ("mean IoU of all in the reference", ""),
    "mean_iou_found": ("mean IoU of those found", ""),
    "area_completeness": ("completeness, by area", ""),
    "area_correctness": ("correctness, by area", ""),
    "area_iou": ("IoU, by area", ""),
    "boundary_mean": ("boundary distance of those found, mean", "m"),
    "boundary_rms": ("boundary distance of those found, RMS", "m"),
    "boundary_percentile_95": ("boundary distance of those found, 95 %", "m"),
    "boundary_hausdorff": ("boundary distance of those found, largest", "m"),
    "boundary_of_unions_mean": ("boundary distance of the unions, mean", "m"),
    "boundary_of_unions_rms": ("boundary distance of the unions, RMS", "m"),
    "boundary_of_unions_percentile_95": ("boundary distance of the unions, 95 %", "m"),
    "boundary_of_unions_hausdorff": ("boundary distance of the unions, largest", "m"),
    "corner_tolerance": ("corners: tolerance", "m"),
    "corner_n_result": ("corners in the result", "n"),
    "corner_n_reference": ("corners in the reference", "n"),
    "corner_precision": ("corners: precision", ""),
    "corner_recall": ("corners: recall", ""),
    "corner_mean_distance": ("corners: distance of those found, mean", "m"),
    "angle_median_deg": ("angle errors of those found, median", "°"),
    "angle_percentile_95_deg": ("angle errors of those found, 95 %", "°"),
    "angle_matched_share": ("angle errors: share of walls compared", ""),
    "n_vertices_result": ("vertices in the result", "n"),
    "n_vertices_reference": ("vertices in the reference", "n"),
    "n_vertices_reference_simplified": ("vertices in the reference, simplified", "n"),
    "vertices_result": ("vertices of those found", "mean"),
    "vertices_reference": ("vertices of their references", "mean"),
    "vertices_reference_simplified": ("vertices of their references, simplified", "mean"),
    "n_planes_result": ("planes in the result", "n"),
    "n_planes_reference": ("planes in the reference", "n"),
    "n_planes_found": ("planes found (IoU ≥ 0.5)", "n"),
    "weighted_coverage": ("weighted coverage", ""),
    "coverage": ("coverage, unweighted", ""),
    "n_clouds": ("clouds", "n"),
    "mean_precision": ("precision, mean of clouds", ""),
    "mean_recall": ("recall, mean of clouds", ""),
    "mean_f1": ("F1, mean of clouds", ""),
    "mean_weighted_coverage": ("weighted coverage, mean of clouds", ""),
    "adjusted_n_buildings": ("Table 1: buildings with straight walls", "n"),
    "adjusted_n_as_traced": ("Table 1: left out, outline as traced", "n"),
    "adjusted_spacing": ("Table 1: point spacing", "m"),
    "adjusted_max_offset": ("Table 1: largest offset of a point", "m"),
    "adjusted_sigma": ("Table 1: σ", "m"),
    "adjusted_max_offset_share": ("Table 1: largest offset / spacing", ""),
    "adjusted_sigma_share": ("Table 1: σ / spacing", ""),
}


def score_table(title: str, figures: Mapping[str, Any]) -> str:
    """
    Return a title and one line per figure; what has no label (lists) is left to JSON.

    """
    shown = {name: figures[name] for name in LABELS if name in figures}
    width = max(len(LABELS[name][0]) for name in shown)
    lines = [
        f"  {LABELS[name][0]:<{width}}  {_in_words(value, LABELS[name][1])}" for name, value in shown.items()
    ]
    return "\n".join([title, *lines])


def _in_words(value: float | None, unit: str) -> str:
    """
    Write a count, a share, a mean or a length; a dash where there is nothing to take a share of.

    """
    if value is None:
        return f"{'–':>10}"
    if unit == "n":
        return f"{value:>10d}"
    if unit == "m":
        return f"{value:>10.3f} m"
    if unit == "°":
        return f"{value:>10.2f}°"
    return f"{value:>10.2f}" if unit == "mean" else f"{value:>10.4f}"
