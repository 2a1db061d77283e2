"""Views: which pixel is seen directly and which through which mirror, and what each view saw."""
