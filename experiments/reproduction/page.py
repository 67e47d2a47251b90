"""The page of a reproduction: one file of HTML that needs nothing else."""

import base64
import html
import os

# Larger pictures are shown as PNG: an SVG of many thousand curves is slow to draw.
LARGEST_SVG = 600_000
LONG_TABLE = 14  # rows; longer ones are folded

STYLE = """
:root { color-scheme: light dark; --ink: #22262b; --paper: #ffffff; --quiet: #5b636c;
  --line: #d9dde1; --card: #f5f7f8; --blue: #0072b2; --yes: #00684b; --no: #a94400;
  --open: #0062a0; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e4e7ea; --paper: #15181b; --quiet: #a3abb3; --line: #363c42;
    --card: #1e2226; --blue: #6db8e3; --yes: #52c9a2; --no: #f0955a; --open: #7cc0ee; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1.5rem clamp(1rem, 4vw, 3rem) 4rem; max-width: 76rem;
  color: var(--ink); background: var(--paper);
  font: 17px/1.55 system-ui, "DejaVu Sans", sans-serif; overflow-wrap: break-word; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: .5rem 0; }
h2 { font-size: 1.45rem; margin: 3rem 0 .5rem; padding-top: 1rem;
  border-top: 2px solid var(--line); }
h3 { font-size: 1.15rem; margin: 2.2rem 0 .3rem; }
a { color: var(--blue); }
.quiet { color: var(--quiet); font-size: .88rem; }
.banner { border-left: 4px solid var(--no); background: var(--card);
  padding: .6rem 1rem; margin: 1rem 0; }
.wide { overflow-x: auto; margin: .7rem 0; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: top; padding: .3rem .8rem .3rem 0;
  border-bottom: 1px solid var(--line); }
th { font-weight: 600; }
td:first-child { min-width: 7rem; }
caption { caption-side: top; text-align: left; color: var(--quiet); font-size: .88rem;
  padding-bottom: .3rem; }
.agrees { color: var(--yes); font-weight: 600; white-space: nowrap; }
.differs { color: var(--no); font-weight: 600; }
.open { color: var(--open); font-weight: 600; }
figure { margin: 1rem 0; }
figure img { max-width: 100%; height: auto; background: #fff; border-radius: 4px;
  border: 1px solid var(--line); padding: .4rem; }
figcaption { color: var(--quiet); font-size: .88rem; }
pre { background: var(--card); padding: .6rem .8rem; border-radius: 4px;
  overflow-x: auto; font-size: .85rem; white-space: pre-wrap; }
summary { cursor: pointer; color: var(--blue); }
nav ul { list-style: none; padding: 0; columns: 18rem; }
nav li { margin: .15rem 0; break-inside: avoid; }
@media (max-width: 40rem) {
  .claims thead { display: none; }
  .claims tr { display: block; border-bottom: 2px solid var(--line); padding: .5rem 0; }
  .claims td { display: block; border: 0; padding: .1rem 0; }
  .claims td[data-head]::before { content: attr(data-head) ": "; color: var(--quiet); } }
"""


def Escaped(text):
  return html.escape(str(text), quote=True)


def Verdict(claim, smoke):
  if claim.agrees is None:
    because = ": " + Escaped(claim.because) if claim.because else ""
    return '<span class="open">%s</span>%s' % (
        "open there" if claim.theirs == "open" else "ours", because)
  if smoke:
    return '<span class="quiet">not judged at this size</span>'
  if claim.agrees:
    return '<span class="agrees">agrees</span>'
  if claim.because:
    return '<span class="differs">differs</span> because ' + Escaped(claim.because)
  return '<span class="differs">differs</span>, and it is open why'


def ClaimsTable(claims, smoke):
  rows = "".join(
      '<tr><td>%s</td><td data-head="claimed">%s</td><td data-head="here">%s</td>'
      '<td data-head="verdict">%s</td></tr>'
      % (Escaped(c.text), Escaped(c.theirs), Escaped(c.ours), Verdict(c, smoke))
      for c in claims)
  return ('<div class="wide"><table class="claims"><thead><tr><th>claim</th>'
          '<th>claimed</th><th>here</th><th>verdict</th></tr></thead><tbody>'
          + rows + "</tbody></table></div>")


def DataTable(table):
  head = "".join("<th>%s</th>" % Escaped(cell) for cell in table.head)
  rows = "".join("<tr>%s</tr>" % "".join("<td>%s</td>" % Escaped(cell)
                                         for cell in row) for row in table.rows)
  text = ('<div class="wide"><table><caption>%s</caption><thead><tr>%s</tr></thead>'
          "<tbody>%s</tbody></table></div>" % (Escaped(table.caption), head, rows))
  if len(table.rows) <= LONG_TABLE:
    return text
  return "<details><summary>%s (%d rows)</summary>%s</details>" % (
      Escaped(table.caption), len(table.rows), text)


def Picture(folder, stem, caption):
  path = os.path.join(folder, stem + ".svg")
  kind = "svg+xml"
  if not os.path.exists(path) or os.path.getsize(path) > LARGEST_SVG:
    path, kind = os.path.join(folder, stem + ".png"), "png"
  if not os.path.exists(path):
    return ""
  with open(path, "rb") as file:
    data = base64.b64encode(file.read()).decode("ascii")
  return ('<figure><img loading="lazy" alt="%s" src="data:image/%s;base64,%s">'
          "<figcaption>%s</figcaption></figure>"
          % (Escaped(caption), kind, data, Escaped(caption)))


def Duration(seconds):
  if seconds < 100:
    return "%.0f s" % seconds
  return "%.0f min" % (seconds / 60) if seconds < 6000 else "%.1f h" % (seconds / 3600)


def Section(result, smoke):
  """One study: its claims, figures, tables, and where they come from."""
  study = result.study
  parts = ['<h3 id="%s">%s <span class="quiet">%s</span></h3>'
           % (study.key, Escaped(study.title), Escaped(study.source))]
  if result.failure:
    parts.append('<p class="banner">%s</p>' % Escaped(result.failure))
    if result.last_lines:
      parts.append("<pre>%s</pre>" % Escaped(result.last_lines))
  else:
    if result.status == 1:
      parts.append('<p class="quiet">Some of its runs did not converge; the tables '
                   "say which.</p>")
    if result.claims:
      parts.append(ClaimsTable(result.claims, smoke))
    parts += [Picture(result.folder, stem, caption) for stem, caption in study.figures]
    parts += [DataTable(table) for table in result.tables]
  parts.append("<details><summary>where this comes from</summary><pre>%s</pre>"
               '<p class="quiet">%s</p></details>'
               % (Escaped(result.shown_command), Escaped(result.origin)))
  return "\n".join(parts)


def Page(results, smoke, facts):
  """The page, of results in the order of the studies; facts: (name, value) pairs."""
  claims = [claim for result in results for claim in result.claims
            if claim.agrees is not None]
  agree = sum(claim.agrees for claim in claims)
  failed = [result for result in results if result.failure]
  parts = ["<!doctype html>", '<html lang="en"><head><meta charset="utf-8">',
           '<meta name="viewport" content="width=device-width, initial-scale=1">',
           '<link rel="icon" href="data:,">',
           "<title>granopt: what was reproduced</title>",
           "<style>%s</style></head><body>" % STYLE,
           "<h1>granopt: what was reproduced</h1>"]
  if smoke:
    parts.append('<p class="banner">A smoke run: systems of seconds, which show that '
                 "everything works. Numbers mean nothing at this size and are not "
                 "judged.</p>")
  else:
    parts.append("<p>%d of %d claims agree with what was measured here, %d differ, "
                 "with the reason beside them.</p>"
                 % (agree, len(claims), len(claims) - agree))
  if failed:
    parts.append('<p class="banner">Not there: %s.</p>' % ", ".join(
        '<a href="#%s">%s</a>' % (r.study.key, Escaped(r.study.title))
        for r in failed))
  parts.append('<p class="quiet">%s</p>' % "; ".join(
      "%s: %s" % (Escaped(name), Escaped(value)) for name, value in facts))
  parts.append("<nav><ul>%s</ul></nav>" % "".join(
      '<li><a href="#%s">%s</a> <span class="quiet">%s</span></li>'
      % (r.study.key, Escaped(r.study.title), Escaped(r.study.source))
      for r in results))
  part = None
  for result in results:
    if result.study.part != part:
      part = result.study.part
      parts.append("<h2>%s</h2>" % Escaped(part))
    parts.append(Section(result, smoke))
  parts.append("</body></html>\n")
  return "\n".join(parts)
