"""Reading of XML to a tree of elements with line numbers; entities, which could unpack to any size,
are rejected."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from sepmc.formats.text_table import FormatError, number
from sepmc.scene.messages import printable, shorten

_DEPTH = 200  # of nested elements


@dataclass
class Element:
    """Element of an XML file.

    Attributes
    ----------
    tag : str
        Without the prefix of a namespace.
    attributes : dict of str to str
    line : int
        Line of its start, from 1.
    text : str
        Text in the element itself, without that in its children.
    children : list of Element
        In the order of the file.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    text: str = ""
    children: list["Element"] = field(default_factory=list)

    def all(self, tag: str) -> Iterator["Element"]:
        """Yield all descendants that have a tag, in the order of the file.

        Parameters
        ----------
        tag : str

        Yields
        ------
        Element
        """
        stack = self.children[::-1]
        while stack:
            element = stack.pop()
            if element.tag == tag:
                yield element
            stack += element.children[::-1]

    def child(self, tag: str) -> "Element | None":
        """Return the first child that has a tag; None if there is none.

        Parameters
        ----------
        tag : str

        Returns
        -------
        Element or None
        """
        return next((each for each in self.children if each.tag == tag), None)

    def numbers(self, text: str, what: str, count: int = 0) -> list[float]:
        """Convert a text of this element to finite numbers.

        Parameters
        ----------
        text : str
            Numbers separated by blanks or commas.
        what : str
            Name of the text for messages.
        count : int
            How many numbers are expected; 0 for any.

        Returns
        -------
        list of float

        Raises
        ------
        FormatError
            If the text has more or fewer numbers, or anything but finite numbers.
        """
        try:
            values = [number(cell) for cell in text.replace(",", " ").split()]
        except ValueError:
            hint = "; expand it by xacro first" if "${" in text else ""
            raise FormatError(
                f"line {self.line}: {what} = {shorten(text)} is no number{hint}"
            ) from None
        if (count and len(values) != count) or not all(abs(x) < 1e300 for x in values):
            expected = f"{count or 'some'} finite number{'' if count == 1 else 's'}"
            raise FormatError(f"line {self.line}: {what} = {shorten(text)}: must be {expected}")
        return values


def parse_xml(text: str) -> Element:
    """Parse a text of XML to a tree.

    Parameters
    ----------
    text : str

    Returns
    -------
    Element
        The root element.

    Raises
    ------
    FormatError
        If it is not XML, is nested too deeply, has declarations in its DOCTYPE, or uses an entity
        of an external one.
    """
    parser = expat.ParserCreate("utf-8")
    parser.buffer_text = True
    root, open_elements = Element("", {}, 0), list[Element]()
    open_elements.append(root)

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(open_elements) > _DEPTH:
            raise FormatError(f"line {parser.CurrentLineNumber}: elements are nested too deeply")
        element = Element(tag.rpartition(":")[2], attributes, parser.CurrentLineNumber)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def end(_: str) -> None:
        open_elements.pop()

    def data(piece: str) -> None:
        open_elements[-1].text += piece

    def refuse(*_: object) -> None:
        raise FormatError(
            f"line {parser.CurrentLineNumber}: has entities of its own, or other declarations "
            "in its DOCTYPE, which are not read: write out the entities and remove the DOCTYPE"
        )

    def document_type(_: str, __: str | None, ___: str | None, has_declarations: bool) -> None:
        if has_declarations:  # the name of an external one is never opened
            refuse()

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler, parser.StartDoctypeDeclHandler = data, document_type
    parser.SkippedEntityHandler = refuse
    try:
        parser.Parse(text.encode("utf-8", errors="replace"), True)
    except expat.ExpatError as error:
        reason = printable(expat.ErrorString(error.code))
        raise FormatError(f"line {error.lineno}: is no XML: {reason}") from None
    return root.children[0]
