#!/bin/sh
# Makes the pictures and the sample output of the documentation. Run from the repository's root.
set -eu
net=examples/champions/HET.net.json
work=$(mktemp -d)
trap 'rm -r "$work"' EXIT

ohmloom map "$net" --hardware het_mixed --out "$work/map" > /dev/null
ohmloom replay "$net" --hardware het_mixed --seed 3 --out "$work/replay.png" > /dev/null
# Fewer colours: a third of the bytes. Median cut would merge the colours of the legend, maximum coverage keeps them.
python - "$work/map/crossbars.png" "$work/replay.png" <<'PY'
import sys
from pathlib import Path

from PIL import Image

for name in map(Path, sys.argv[1:]):
    image = Image.open(name).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    image.save(Path("docs/images") / name.name, optimize=True)
PY

mkdir -p docs/examples
command="ohmloom evaluate $net --hardware het_mixed --dies 20 --seed 1"
{ echo "\$ $command"; $command 2> /dev/null || test $? -eq 1; } > docs/examples/evaluate.txt
python - <<'PY'
import csv
import re
from pathlib import Path

readme = Path("README.md")
table = "| system | goal reached from fresh starts | 95 % interval | synapses |\n|---|---|---|---|\n"
with open("examples/champions/champions.csv") as file:
    for row in csv.DictReader(file):
        success, low, high = (100 * float(row[key]) for key in ("test_success", "test_low", "test_high"))
        count = f"{success:.1f} % of {row['test_starts']}"
        table += f"| {row['system']} | {count} | {low:.1f} to {high:.1f} % | {row['synapses']} |\n"
shown = {"evaluate": "```text\n" + Path("docs/examples/evaluate.txt").read_text() + "```\n", "champions": table}
text = readme.read_text()
for name, block in shown.items():
    marked = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    text = marked.sub(lambda found: found[1] + block + found[2], text)
readme.write_text(text)
PY
