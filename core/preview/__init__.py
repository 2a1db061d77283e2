"""Pictures: meshes drawn without a graphics card, colours, and picking in them."""
