"""What every page has: the head with its policy, title, theme button, links to its sections, scripts."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Sequence
from hashlib import sha256
from importlib.resources import files
from string import Template

from dynid._version import __version__
from dynid.report.page.html import Markup, join, tag, text
from dynid.report.style import css

Section = tuple[str, Markup]


def shell(
    title: str,
    subtitle: str,
    sections: Iterable[Section],
    scripts: Sequence[str] = (),
    live: int | None = None,
) -> str:
    """Return a page of sections, with a policy that lets it load nothing and run only its own scripts.

    Parameters
    ----------
    title, subtitle
        What it is about.
    sections
        Heading and content of each.
    scripts
        Names of files of JavaScript, beside the one of all pages.
    live
        The number of this page, where its scripts listen to the server that it came from.
    """
    code = [_asset(name) for name in ("page.js", *scripts)]
    every = [(heading, heading.lower().replace(" ", "-"), content) for heading, content in sections]
    body = join(
        _header(title, subtitle, [(heading, name) for heading, name, _ in every]),
        *(_news(live) if live is not None else ()),
        tag("main", *(_section(*one) for one in every), id="main", tabindex="-1"),
        tag("footer", f"Made by dynid {__version__}"),
    )
    return Template(_asset("page.html")).substitute(
        policy=_policy(code, live is not None),
        title=text(title),
        css=_asset("page.css") + css(),
        body=body,
        scripts="\n".join(f"<script>{script}</script>" for script in code),
    )


def _header(title: str, subtitle: str, links: Iterable[tuple[str, str]]) -> Markup:
    what = "Switch between light and dark"
    button = tag("button", "Dark", id="theme", type="button", class_="no-script", title=what)
    items = (tag("li", tag("a", heading, href=f"#{name}")) for heading, name in links)
    return tag(
        "header",
        tag("div", tag("h1", tag("bdi", title)), button, class_="row"),
        tag("p", subtitle, class_="quiet"),
        tag("nav", tag("ul", *items), aria_label="Sections"),
    )


def _section(heading: str, name: str, content: Markup) -> Markup:
    title = tag("h2", heading, id=f"{name}-title")
    return tag("section", title, content, id=name, class_="card", aria_labelledby=f"{name}-title")


def _news(live: int) -> tuple[Markup, Markup]:
    """Return where a page that listens says what is going on."""
    state = tag("div", id="state", class_="quiet", role="status", data_version=str(live))
    return state, tag("div", id="fault", class_="card", role="alert")


def _policy(code: Iterable[str], live: bool) -> str:
    digests = (b64encode(sha256(script.encode()).digest()).decode() for script in code)
    hashes = " ".join(f"'sha256-{digest}'" for digest in digests)
    connect = "connect-src 'self'; " if live else ""
    return (
        f"default-src 'none'; style-src 'unsafe-inline'; script-src {hashes}; {connect}"
        "base-uri 'none'; form-action 'none'"
    )


def _asset(name: str) -> str:
    return (files("dynid.report.page") / name).read_text(encoding="utf-8")
