"""What the add-on says, in the user's language."""

__all__ = ["messages", "texts"]
