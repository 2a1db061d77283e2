"""The subject: which pixels of each view show the person or object, and which the floor and the room."""

__all__ = ["subject_search", "subject_views"]
