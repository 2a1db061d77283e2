"""Light that reaches the subject two ways: straight from the camera and by way of the mirrors; predicted and undone."""

__all__ = ["two_way_light"]
