"""Writing reports and tables so that a reader never meets half of one."""

import os
import threading
from pathlib import Path

from revline.errors import InvalidInputError


def write_whole(path: str | Path, content: bytes, what: str) -> None:
    """Write a file beside its place and move it there when it is whole; a file of that name is replaced.

    Args:
        path: the file.
        content: its bytes.
        what: what it is, for messages: "report".

    Raises:
        InvalidInputError: the folder is missing or may not be written, the path is a folder, or the disk refuses.
    """
    target = Path(path)
    part = target.with_name(f".{target.name}.{os.getpid()}-{threading.get_ident()}.part")
    try:
        try:
            part.write_bytes(content)
            part.replace(target)
        finally:
            part.unlink(missing_ok=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        message = f"{what} {str(path)!r} cannot be written: {reason}; name a file in a folder that exists and may be written"
        raise InvalidInputError(message, path=str(path)) from error
