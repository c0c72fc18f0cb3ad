#!/bin/sh
# Makes the pictures and the sample output of the documentation. Run from the repository's root.
set -eu
net=examples/champions/HET.net.json
work=$(mktemp -d)
trap 'rm -r "$work"' EXIT

ohmloom map "$net" --hardware het_mixed --out "$work/map" > /dev/null
ohmloom replay "$net" --hardware het_mixed --seed 3 --out "$work/replay.png" > /dev/null
ohmloom device fit pickett --series-resistance 2.4k --law tio2_threshold --holdout pickett_fast --out "$work/fit" > /dev/null
# Fewer colours: a third of the bytes. Median cut would merge the colours of the legend, maximum coverage keeps them.
python - "$work/map/crossbars.png" "$work/map/example.png" "$work/map/pulses.png" "$work/replay.png" "$work/fit/fit.png" <<'PY'
import sys
from pathlib import Path

from PIL import Image

for name in map(Path, sys.argv[1:]):
    image = Image.open(name).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    image.save(Path("docs/images") / name.name, optimize=True)
PY

mkdir -p docs/examples
python benchmarks/maps.py > docs/examples/maps.txt
# The tables of docs/fitting.md take half an hour, and a folder of measured files that is not part of the repository.
if [ -n "${MEASURED:-}" ]; then
  for what in errors success coverage speed; do
    data=
    [ "$what" = coverage ] || data="--data $MEASURED"
    # shellcheck disable=SC2086
    python benchmarks/fits.py $what $data > "docs/examples/fits_$what.txt"
  done
fi
python - <<'PY'
import numpy as np
from matplotlib.figure import Figure

from ohmloom.circuits import Crossbar, SinhConduction, plot_crossbar, plot_schematic

g = np.random.default_rng(1).uniform(5e-5, 1e-3, (4, 3))
g[1, 2] = 0.0
array = Crossbar(conductance=g, r_row=5.0, r_column=5.0, conduction=SinhConduction(scale=0.3))
figure = Figure(figsize=(12, 5), layout="constrained")
circuit, heat = figure.subplots(1, 2)
plot_schematic(array, [1.0, 0.5, 0.0, -0.7], ax=circuit)
plot_crossbar(array, [1.0, 0.5, 0.0, -0.7], what="ir_drop", ax=heat)
figure.savefig("docs/images/schematic.png", dpi=110, metadata={"Software": None})
PY
command="ohmloom evaluate $net --hardware het_mixed --dies 20 --seed 1"
{ echo "\$ $command"; $command 2> /dev/null || test $? -eq 1; } > docs/examples/evaluate.txt
python - <<'PY'
import csv
import re
from pathlib import Path

fitting = Path("docs/fitting.md")
text = fitting.read_text()
for what in ("errors", "success", "coverage", "speed"):
    block = "```text\n" + Path(f"docs/examples/fits_{what}.txt").read_text() + "```\n"
    marked = re.compile(rf"(<!-- {what} -->\n).*?(<!-- end -->)", re.DOTALL)
    text, count = marked.subn(lambda found, block=block: found[1] + block + found[2], text)
    assert count == 1, what
fitting.write_text(text)

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
