"""XML of files that others wrote: parsed without entities or document types, which could fill the memory."""

import re
from typing import Any

from thalweg.world.errors import WorldError
from thalweg.world.real.sources.extra import need

UTF_16 = (b"\xff\xfe", b"\xfe\xff")
"""Marks with which text in UTF-16 begins."""
DECLARED = re.compile(rb"""(?:\xef\xbb\xbf)?\s*<\?xml[^>]*?encoding=["']([A-Za-z0-9._-]+)["']""")
DECLARATION = re.compile(r"^\ufeff?\s*<\?xml.*?\?>", re.DOTALL)
MAX_XML_BYTES = 16_000_000
"""Maximum size of an XML file; parsed, it takes many times its size."""


def parse_xml(content: bytes) -> Any:
    """Return the root element of a document; raises `WorldError` for anything but plain, well-formed XML."""
    if len(content) > MAX_XML_BYTES:
        raise WorldError(f"{len(content) / 1e6:.0f} MB of XML; limit {MAX_XML_BYTES / 1e6:.0f} MB: keep only the river")
    tree = need("defusedxml.ElementTree", "an XML file, such as GPX or KML,")
    common = need("defusedxml.common", "an XML file")
    try:
        return tree.fromstring(content, forbid_dtd=True)
    except common.DefusedXmlException:
        raise WorldError("its XML has a document type or entities, which GPX and KML do not need: refused") from None
    except (tree.ParseError, LookupError, ValueError) as reason:
        raise WorldError(f"not XML: {reason}") from None


def text_of_xml(content: bytes) -> str:
    """Return the text of a document that `parse_xml` has read, without its declaration, which names its encoding."""
    named = DECLARED.match(content)
    encoding = "utf-16" if content[:2] in UTF_16 else named[1].decode() if named else "utf-8-sig"
    return DECLARATION.sub("", content.decode(encoding), count=1)


def local_name(element: Any) -> str:
    """Return the name of an element without its namespace; empty for comments."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""
