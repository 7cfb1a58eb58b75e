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
