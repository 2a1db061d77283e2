"""Joints found in a closed mesh: a body template of numbers, fitted in shape and pose."""

__all__ = ["body_template", "person_check", "skeleton_search", "template_fit"]
