"""The subject: which pixels of each view show the person or object, and which the floor and the room."""
