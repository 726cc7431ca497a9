"""How the page looks: one column, light or dark as the reader's screen is."""

from typing import Final

CSS: Final = """
:root { color-scheme: light dark; --ink: #1b1f24; --paper: #fdfdfc; --faint: #57606a; --line: #d0d5db;
        --mark: #fff4d6; --mark-line: #b7791f; --link: #0b5cad; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e8eb; --paper: #16191d; --faint: #9aa3ad; --line: #3a4048; --mark: #2f2714;
          --mark-line: #d6a13a; --link: #79b8ff; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 2rem 1rem 4rem; max-width: 62rem; background: var(--paper); color: var(--ink);
       font: 1rem/1.55 system-ui, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .5rem; }
h2 { font-size: 1.25rem; margin: 2.8rem 0 .6rem; padding-top: .6rem; border-top: 1px solid var(--line); }
p, li { max-width: 46rem; overflow-wrap: anywhere; }
nav ul { columns: 2; padding-left: 1.2rem; }
a { color: var(--link); }
figure { margin: 1.2rem 0 .4rem; overflow-x: auto; }
figure img { display: block; width: 100%; min-width: 40rem; height: auto; }
figcaption { color: var(--faint); font-size: .9rem; max-width: 46rem; }
.wide { overflow-x: auto; margin: .6rem 0; }
table { border-collapse: collapse; font-size: .86rem; font-variant-numeric: tabular-nums; }
caption, summary { text-align: left; color: var(--faint); font-size: .9rem; padding: .3rem 0; }
caption { max-width: 46rem; }
summary { cursor: pointer; }
th, td { padding: .22rem .7rem .22rem 0; text-align: left; vertical-align: top; }
td { min-width: 3.2rem; max-width: 26rem; }
th { border-bottom: 1px solid var(--ink); font-weight: 600; }
td { border-bottom: 1px solid var(--line); overflow-wrap: break-word; }
td.number { text-align: right; white-space: nowrap; }
th.number { text-align: right; }
.cautions { background: var(--mark); border-left: 4px solid var(--mark-line); padding: .2rem 1rem .6rem; }
.cautions h2 { border: 0; margin-top: .6rem; }
code { font-size: .9em; overflow-wrap: anywhere; }
@media print { nav { display: none; } details > * { display: revert; } }
"""
