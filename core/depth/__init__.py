"""Depth: a burst becomes one map, its noise is measured, each view is cleaned."""

__all__ = [
    "burst_fusion",
    "burst_motion",
    "clean_views",
    "depth_map",
    "dequantisation",
    "noise_estimate",
    "outliers_and_dropouts",
    "sensor_recognition",
    "settings",
]
