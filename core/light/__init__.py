"""Light that reaches the subject two ways: straight from the camera and by way of the mirrors; predicted and undone."""

__all__ = ["phase_response", "surface_light", "two_way_light"]
