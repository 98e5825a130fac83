"""Text files, read and written with errors that say what to do."""

from pathlib import Path

from revline.errors import InvalidInputError


def read_text(path: Path, what: str) -> str:
    """Read a text file in UTF-8, with or without a byte order mark.

    Args:
        path: the file.
        what: what it should be, for messages: "engine file".

    Raises:
        InvalidInputError: the file is missing, is a directory, cannot be read, or is no UTF-8 text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        message = f"{what} {path} does not exist; check the path"
        raise InvalidInputError(message, path=str(path)) from error
    except IsADirectoryError as error:
        message = f"{what} {path} is a directory; name a file in it"
        raise InvalidInputError(message, path=str(path)) from error
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        message = f"{what} {path}, line {line}: not UTF-8 text ({error.reason}); save it with the encoding UTF-8"
        raise InvalidInputError(message, path=str(path), line=line) from error
    except (OSError, ValueError) as error:
        message = f"{what} {str(path)!r} cannot be read: {error}; check its name and permissions"
        raise InvalidInputError(message, path=str(path)) from error


def write_text(path: Path, text: str, what: str) -> None:
    """Write a text file in UTF-8 with newline endings; a file of that name is replaced.

    Args:
        path: the file.
        text: its content.
        what: what it is, for messages: "engine file".

    Raises:
        InvalidInputError: the folder is missing or the file cannot be written.
    """
    try:
        path.write_text(text, encoding="utf-8", newline="\n")
    except FileNotFoundError as error:
        message = f"{what} {path} cannot be written: its folder {path.parent} does not exist; make it first"
        raise InvalidInputError(message, path=str(path)) from error
    except (OSError, ValueError) as error:
        message = f"{what} {str(path)!r} cannot be written: {error}; name a file in a folder that may be written"
        raise InvalidInputError(message, path=str(path)) from error
