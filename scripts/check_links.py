#!/usr/bin/env python3
"""Looks for dead links: check_links.py [FOLDER]

In the Markdown files of the repository (no FOLDER), or in the pages of a built site. A link inside must lead to a
file that is there, and behind a # to a heading (or id) of it; links to other sites are not followed.
"""
import html.parser
import pathlib
import re
import sys
import urllib.parse


def anchor(heading):
    """The id that GitHub (and Python-Markdown, for ASCII) gives a heading."""
    text = re.sub(r"`|\*|\[([^\]]*)\]\([^)]*\)", lambda m: m.group(1) or "", heading).strip().lower()
    return re.sub(r"[^\w\- ]", "", text).replace(" ", "-")


class MarkdownPage:
    def __init__(self, path):
        text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.M | re.S)
        self.ids = {anchor(h) for h in re.findall(r"^#+ +(.*?)\s*$", text, flags=re.M)}
        text = re.sub(r"`[^`\n]*`", "", text)
        self.links = re.findall(r"\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)", text)


class HtmlPage(html.parser.HTMLParser):
    def __init__(self, path):
        super().__init__()
        self.ids, self.links = set(), []
        self.feed(path.read_text(encoding="utf-8", errors="replace"))

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.ids |= {values[key] for key in ("id", "name") if values.get(key)}
        self.links += [values[key] for key in ("href", "src") if values.get(key)]


def load(path, pages):
    if path not in pages:
        kinds = {".md": MarkdownPage, ".html": HtmlPage}
        kind = kinds.get(path.suffix)
        pages[path] = kind(path) if kind else None
    return pages[path]


def dead_links(path, root, pages):
    for link in load(path, pages).links:
        parts = urllib.parse.urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        target = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
        if parts.path.startswith("/"):
            yield link, "begins at the root of the disk"
        elif not target.is_relative_to(root):
            yield link, "leads out of the folder"
        elif not target.is_file():
            yield link, "no such file"
        elif parts.fragment:
            page = load(target, pages)
            if page and urllib.parse.unquote(parts.fragment) not in page.ids:
                yield link, "no such heading"


def main():
    if len(sys.argv) > 1:
        root = pathlib.Path(sys.argv[1]).resolve()
        # Not those that others made: Doxygen's, and the page that a server shows where nothing is.
        files = sorted(p for p in root.rglob("*.html") if "api" not in p.parts and p.name != "404.html")
    else:
        root = pathlib.Path(__file__).resolve().parent.parent
        build = root / "build"
        files = sorted(p for p in root.rglob("*.md") if build not in p.parents)
    pages, links, dead = {}, 0, 0
    for path in files:
        links += len(load(path, pages).links)
        for link, why in dead_links(path, root, pages):
            print(f"{path.relative_to(root)}: {link}: {why}", file=sys.stderr)
            dead += 1
    print(f"{links} links in {len(files)} files, {dead} dead")
    return 1 if dead or not links else 0


if __name__ == "__main__":
    sys.exit(main())
