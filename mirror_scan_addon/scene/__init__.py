"""What stands in Blender's scene: properties, captures, mirrors, avatars."""
