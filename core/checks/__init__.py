"""Checks: what is wrong with a scene or a result, in words that say what to do."""

__all__ = [
    "camera_contradictions",
    "mirror_quality",
    "plausibility",
    "reflection_forecast",
    "scene_advice",
    "seat",
    "view_disagreement",
]
