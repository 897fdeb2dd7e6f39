"""A generated folder as a whole: written atomically, what it may hold, and whether it is what its design gives."""

from lockstep.codegen.folder.write import check_replaceable, write_folder

__all__ = ["check_replaceable", "write_folder"]
