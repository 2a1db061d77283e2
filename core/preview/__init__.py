"""Pictures: meshes drawn without a graphics card, colours, and picking in them."""

__all__ = ["mesh_views", "palette", "point_picking", "posed_views"]
