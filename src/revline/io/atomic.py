"""Writing files so that a reader never meets half of one."""

import os
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

from revline.errors import InvalidInputError


def write_atomically(path: str | Path, text: str, what: str) -> None:
    """Write a text file in UTF-8 beside its place and move it there when it is whole; a file of that name is replaced.

    What is no regular file, such as /dev/stdout, is written to directly. If anything fails, the old file stays as it was.

    Args:
        path: the file; a link is followed.
        text: its content.
        what: what it is, for messages: "controller file".

    Raises:
        InvalidInputError: the folder is missing or may not be written, the path is a folder, or the disk refuses.
    """
    _refuse(lambda: _write(Path(path), text), path, what)


def check_writable(path: str | Path, what: str) -> None:
    """Refuse a file that `write_atomically` could not write, before the work whose result it is to hold; nothing is left behind.

    Args:
        path: the file.
        what: what it is, for messages.

    Raises:
        InvalidInputError: the folder is missing or may not be written, or the path is a folder.
    """
    _refuse(lambda: _try_folder(Path(path)), path, what)


def _try_folder(path: Path) -> None:
    target = path.resolve()
    if target.is_dir():
        raise IsADirectoryError(str(target))
    if not target.exists() or target.is_file():
        with tempfile.NamedTemporaryFile(dir=target.parent, prefix=f".{target.name[:40]}.", suffix=".part"):
            pass


def _write(path: Path, text: str) -> None:
    target = path.resolve()
    if target.is_dir():
        raise IsADirectoryError(str(target))
    if target.exists() and not target.is_file():
        target.write_text(text, encoding="utf-8", newline="\n")
        return
    part = target.with_name(f".{target.name}.{os.getpid()}-{threading.get_ident()}.part")
    try:
        with part.open("w", encoding="utf-8", newline="\n") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        part.replace(target)
    finally:
        part.unlink(missing_ok=True)


def _refuse(act: Callable[[], None], path: str | Path, what: str) -> None:
    """Act, and turn what the system refuses into a message that says what to do."""
    try:
        act()
    except FileNotFoundError as error:
        message = f"{what} {path} cannot be written: its folder {Path(path).parent} does not exist; make it first"
        raise InvalidInputError(message, path=str(path)) from error
    except IsADirectoryError as error:
        message = f"{what} {path} cannot be written: it is a folder; name a file in it"
        raise InvalidInputError(message, path=str(path)) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        message = f"{what} {str(path)!r} cannot be written: {reason}; name a file in a folder that may be written and has space"
        raise InvalidInputError(message, path=str(path)) from error
