"""The avatar: the closed mesh in its own frame."""
