"""Citation of dynid and of the two papers that it implements."""

from __future__ import annotations

from dynid._version import __version__

_ENTRIES = """\
@software{{dynid,
  title   = {{dynid: bond graphs in the frequency domain, and joint identification on reduced
             finite-element models}},
  author  = {{{{The dynid founders}}}},
  version = {{{version}}}
}}

@article{{park1997,
  title  = {{Understanding of Dynamic System Properties in the Frequency Domain Using Bond Graphs}},
  author = {{Park, Jeon Soo and Kim, Jong Shik}},
  year   = {{1997}}
}}

@article{{yang1997,
  title  = {{A Study on Improving the Accuracy of Finite Element Modeling Using System Identification
            Technique}},
  author = {{Yang, Kyung-Taek}},
  year   = {{1997}}
}}"""


def citation() -> str:
    """Return BibTeX entries for this version and for the papers."""
    return _ENTRIES.format(version=__version__)
