"""The document on paper: typst sets the same content as a PDF, offline, with the fonts it brings along."""

import importlib
from importlib.resources import files
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType

from revline.errors import AnalysisError, InvalidInputError
from revline.report.document import Document
from revline.report.files import write_whole
from revline.report.images import load_picture
from revline.report.typst_source import TypstWriter, picture_path


def render_pdf(document: Document) -> bytes:
    """Set the document as a PDF.

    Args:
        document: what it says; its figures' files must be there.

    Returns:
        The PDF, the same for the same document, files and version of typst: no date is in it.

    Raises:
        InvalidInputError: typst is not installed, or a figure's file is missing or is no picture.
        AnalysisError: typst refuses, as it does a damaged picture.
    """
    typst = _load_typst()
    with TemporaryDirectory(prefix="revline-report-") as name:
        folder = Path(name)
        pictures = {figure.anchor: load_picture(figure) for figure in document.figures}
        for figure in document.figures:
            (folder / picture_path(figure, pictures[figure.anchor])).write_bytes(pictures[figure.anchor].content)
        look = files("revline.report").joinpath("templates", "report.typ").read_text(encoding="utf-8")
        (folder / "report.typ").write_text(look, encoding="utf-8")
        main = folder / "main.typ"
        main.write_text(TypstWriter(document.labels, pictures).write(document), encoding="utf-8")
        return _compile(typst, main)


def write_pdf(document: Document, path: str | Path) -> None:
    """Write the document as a PDF.

    Args:
        document: what it says.
        path: of the file; one of that name is replaced.

    Raises:
        InvalidInputError: typst is not installed, a figure's file is missing or is no picture, or the file cannot be written.
        AnalysisError: typst refuses, as it does a damaged picture.
    """
    write_whole(path, render_pdf(document), "report")


def _compile(typst: ModuleType, main: Path) -> bytes:
    try:
        pdf: bytes = typst.compile(main, root=main.parent, ignore_system_fonts=True)
    except RuntimeError as error:
        message = f"typst could not set the report: {error}; look for a damaged figure, the HTML report does without typst"
        raise AnalysisError(message) from error
    return pdf


def _load_typst() -> ModuleType:
    try:
        return importlib.import_module("typst")
    except ImportError as error:
        message = "the PDF is set by typst, which is not installed; pip install revline[report], or use the HTML report"
        raise InvalidInputError(message) from error
