"""The subject: which pixels of each view show the person or object, and which the floor and the room."""

__all__ = ["connected_pixels", "image_border", "subject_search", "subject_views"]
