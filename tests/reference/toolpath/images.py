"""The images of appendix E's path under the transforms of the thesis' table 4.2.

    python images.py

Independent of openumi: reads words with a regular expression, multiplies with Python's
rational numbers, rounds nothing. Writes appendix_e_case1.csv to appendix_e_case4.csv: block
number, nominal x y z, image x y z with nine decimals, mm. Where the path has not said a
height since it went home (N140), the last one stands, as in appendix F.
"""

import json
import re
from fractions import Fraction
from pathlib import Path

HERE = Path(__file__).parent


def blocks(text):
    """Block number and place of every motion in work coordinates."""
    place = {}
    for line in text.splitlines():
        line = re.sub(r"\(.*?\)", "", line)
        codes = re.findall(r"G0*(\d+)", line)
        axes = re.findall(r"([XYZ])([-+.\d]+)", line)
        # G10 sets data, G28 goes home: both take the words for themselves.
        if not axes or "10" in codes or "28" in codes:
            continue
        place.update((axis, Fraction(value)) for axis, value in axes)
        yield re.match(r"N(\d+)", line)[1], [place[axis] for axis in "XYZ"]


def main():
    path = (HERE / "appendix_e.nc").read_text()
    for case in range(1, 5):
        fit = HERE.parent / "fits" / f"registration_thesis_table_4_2_case{case}.json"
        result = json.loads(fit.read_text(), parse_float=Fraction)["result"]
        rows = ["n,x,y,z,image_x,image_y,image_z"]
        for number, p in blocks(path):
            image = [
                sum(Fraction(r) * c for r, c in zip(row, p)) + Fraction(t)
                for row, t in zip(result["R"], result["t"])
            ]
            values = [f"{float(c):.3f}" for c in p] + [f"{float(c):.9f}" for c in image]
            rows.append(",".join([number, *values]))
        (HERE / f"appendix_e_case{case}.csv").write_text("\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
