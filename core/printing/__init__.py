"""The avatar as a thing to print: scaled, hollow, on a plate; and whether it can be printed."""

from .print_checks import check_print
from .print_mesh import prepare_print
from .print_settings import PrintLimits, PrintSettings

__all__ = ["PrintLimits", "PrintSettings", "check_print", "prepare_print"]
