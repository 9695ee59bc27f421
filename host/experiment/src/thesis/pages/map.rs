//! Deviation maps: a measured surface in colours, as inspection reports show it.

use std::fmt::Write as _;

use umi_virtual::cutting::SurfaceDeviations;

use umi_report::draw::markup::{Element, el};
use umi_report::draw::number::{fixed, signed};
use umi_report::draw::svg::{self, picture, px};

/// Bands to each side of nominal.
const SIDES: i32 = 5;

/// From far below nominal (blue) over nominal (grey) to far above (red), told apart
/// with every kind of colour vision (P. Kovesi, arXiv:1509.03700: diverging maps of
/// blue and red); the first and last are for what is beyond the bands.
const COLOURS: [&str; 13] = [
    "#08104f", "#1f3f9a", "#3f68bb", "#6b90d3", "#9db7e4", "#cbd8f0", "#ececec", "#f8d3c6",
    "#f0aa93", "#e17e65", "#c94f3e", "#a81f22", "#4f0510",
];

/// Where no tool has been.
const UNCUT: &str = "#8f8a74";

/// Cells of a map, at most: as many as can be seen.
const CELLS: [usize; 2] = [120, 260];

/// What a map shows.
pub struct Map<'a> {
    /// The measured surface.
    pub deviations: &'a SurfaceDeviations,
    /// Width of a band, mm.
    pub band_mm: f64,
    /// Marked stretches in Y: name, from, to, mm. Infinite borders are the grid's.
    pub stretches: &'a [(String, [f64; 2])],
    /// What it is, for those who cannot see it.
    pub label: &'a str,
}

/// A band's width from which nothing lies outside the bands: a number of one digit times
/// a power of ten, so that the range is hardly wider than what it shows.
#[must_use]
pub fn band_for(largest_mm: f64) -> f64 {
    let need = largest_mm / (f64::from(SIDES) + 0.5);
    if !(need.is_finite() && need > 0.0) {
        return 1.0;
    }
    let decade = 10f64.powf(need.log10().floor());
    [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0]
        .into_iter()
        .map(|digit| digit * decade)
        .find(|band| *band >= need * (1.0 - 1e-9))
        .unwrap_or(10.0 * decade)
}

/// One of the colours: bands are centred on multiples of their width, so that the
/// middle one is nominal.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Band {
    Cut(i32),
    Uncut,
}

impl Band {
    fn colour(self) -> &'static str {
        match self {
            Self::Uncut => UNCUT,
            Self::Cut(band) => usize::try_from(band + SIDES + 1)
                .ok()
                .and_then(|place| COLOURS.get(place))
                .copied()
                .unwrap_or(UNCUT),
        }
    }

    /// All of them, highest first.
    fn all() -> impl Iterator<Item = Self> {
        (-SIDES - 1..=SIDES + 1)
            .rev()
            .map(Self::Cut)
            .chain([Self::Uncut])
    }
}

/// A cell: the mean of its nodes; not cut where most of them are not.
fn cell(map: &Map<'_>, columns: std::ops::Range<usize>, rows: std::ops::Range<usize>) -> Band {
    let (mut sum, mut nodes, mut uncut) = (0.0, 0_u32, 0_u32);
    for row in rows {
        for column in columns.clone() {
            let Some((mm, cut)) = map.deviations.at(column, row) else {
                continue;
            };
            nodes += 1;
            uncut += u32::from(!cut);
            sum += mm;
        }
    }
    if nodes == 0 || 2 * uncut > nodes {
        return Band::Uncut;
    }
    let bands = (sum / f64::from(nodes) / map.band_mm).round();
    let most = f64::from(SIDES + 1);
    #[allow(clippy::cast_possible_truncation, reason = "just clamped")]
    Band::Cut(bands.clamp(-most, most) as i32)
}

/// Where to divide `nodes` into `cells`.
fn division(nodes: usize, cells: usize) -> Vec<std::ops::Range<usize>> {
    let cells = cells.min(nodes).max(1);
    (0..cells)
        .map(|cell| cell * nodes / cells..(cell + 1) * nodes / cells)
        .collect()
}

/// The map with its legend. X goes to the right, Y up.
pub fn drawing(map: &Map<'_>) -> Element {
    const WIDTH: f64 = 230.0;
    const LEFT: f64 = 30.0;
    const TOP: f64 = 12.0;
    let grid = map.deviations.grid();
    let ([left, right], [low, high]) = (grid.x_mm(), grid.y_mm());
    let per_mm = WIDTH / (right - left);
    let height = (high - low) * per_mm;
    let y_px = |y_mm: f64| TOP + (high - y_mm.clamp(low, high)) * per_mm;
    let legend = LEFT + WIDTH + 54.0;
    let mut out = picture(legend + 92.0, TOP + height + 34.0, map.label);

    let columns = division(grid.columns(), CELLS[0]);
    let rows = division(grid.rows(), CELLS[1]);
    let cell_px = [WIDTH / columns.len() as f64, height / rows.len() as f64];
    let cells: Vec<Vec<Band>> = rows
        .iter()
        .map(|row| {
            columns
                .iter()
                .map(|column| cell(map, column.clone(), row.clone()))
                .collect()
        })
        .collect();
    // One path for each colour, one stroke for each run of equal cells in a row.
    for band in Band::all() {
        let mut runs = String::new();
        for (row, bands) in cells.iter().enumerate() {
            let y = TOP + height - (row as f64 + 0.5) * cell_px[1];
            let mut column = 0;
            for run in bands.chunk_by(|a, b| a == b) {
                if run.first() == Some(&band) {
                    let x = LEFT + column as f64 * cell_px[0];
                    let width = run.len() as f64 * cell_px[0];
                    // Writing to a String cannot fail.
                    let _ = write!(runs, "M{} {}h{}", px(x), px(y), px(width));
                }
                column += run.len();
            }
        }
        if !runs.is_empty() {
            out = out.child(
                el("path")
                    .attr("d", runs)
                    .attr("fill", "none")
                    .attr("stroke", band.colour())
                    // A little more than a cell, so that no seam shows.
                    .attr("stroke-width", px(cell_px[1] + 0.15)),
            );
        }
    }
    for (name, [from, to]) in map.stretches {
        let (top, bottom) = (y_px(*to), y_px(*from));
        let right = LEFT + WIDTH;
        out = out.child(svg::text(
            "",
            [right + 5.0, f64::midpoint(top, bottom) + 4.0],
            name,
        ));
        if bottom < TOP + height {
            out = out.child(svg::line("axis", [LEFT, bottom], [right + 30.0, bottom]));
        }
    }
    out = out.child(svg::rect(
        "frame",
        [LEFT, TOP],
        [LEFT + WIDTH, TOP + height],
    ));
    for x in umi_report::draw::scale::ticks(left, right, 4) {
        let at = LEFT + (x - left) * per_mm;
        let foot = TOP + height;
        out = out
            .child(svg::line("axis", [at, foot], [at, foot + 4.0]))
            .child(svg::text("mid", [at, foot + 16.0], &fixed(x, 0)));
    }
    for y in umi_report::draw::scale::ticks(low, high, 6) {
        let at = y_px(y);
        out = out
            .child(svg::line("axis", [LEFT - 4.0, at], [LEFT, at]))
            .child(svg::text("end", [LEFT - 6.0, at + 4.0], &fixed(y, 0)));
    }
    let foot = TOP + height + 30.0;
    out = out.child(svg::text(
        "mid muted",
        [LEFT + WIDTH / 2.0, foot],
        "X along the passes, Y up, mm",
    ));
    out.children(legend_of(map, [legend, TOP]))
}

/// The colours and what they mean.
fn legend_of(map: &Map<'_>, [x, y]: [f64; 2]) -> Vec<Element> {
    const STEP: f64 = 17.0;
    let (unit, factor) = if map.band_mm < 0.1 {
        ("\u{b5}m", 1e3)
    } else {
        ("mm", 1.0)
    };
    let band = map.band_mm * factor;
    let decimals = usize::from(band < 1.0) + usize::from(band < 0.1);
    let mut out = vec![svg::text("b", [x, y + 10.0], unit)];
    for (place, band_of) in Band::all().enumerate() {
        let top = y + 18.0 + STEP * place as f64;
        let border = f64::from(SIDES) + 0.5;
        let name = match band_of {
            Band::Uncut => "not cut".into(),
            Band::Cut(n) if n > SIDES => {
                format!("above {}", signed(border * band, decimals.max(1)))
            }
            Band::Cut(n) if n < -SIDES => {
                format!("below {}", signed(-border * band, decimals.max(1)))
            }
            Band::Cut(n) => signed(f64::from(n) * band, decimals),
        };
        out.push(
            svg::rect("", [x, top], [x + 15.0, top + STEP - 2.0]).attr("fill", band_of.colour()),
        );
        out.push(svg::text("", [x + 20.0, top + 11.0], &name));
    }
    out
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use umi_virtual::cutting::{CylinderArc, Grid, Workpiece};

    use super::*;

    /// Material cut to 4 µm above nominal has the colour of +4 µm, in its half and
    /// nowhere else; material that no tool has touched has its own.
    #[test]
    fn colours_are_those_of_the_deviations() {
        // As good as flat: what follows is exact to 1 µm.
        let arc = CylinderArc {
            axis_y_mm: 0.0,
            axis_z_mm: -1e6,
            radius_mm: 1e6,
        };
        let grid = Grid::new([-10.0, 10.0], [-5.0, 5.0], [0.5, 0.5]).unwrap();
        let mut workpiece = Workpiece::new(grid, |x, _| if x < 0.0 { 1.0 } else { -0.009 });
        let ball = 1e5;
        let center = Vector3::new(0.0, 0.0, ball + 0.004);
        workpiece.sweep(center, center, ball);
        let deviations = SurfaceDeviations::of(&workpiece, &arc);
        let map = Map {
            deviations: &deviations,
            band_mm: 0.002,
            stretches: &[],
            label: "test",
        };
        assert!(cell(&map, 0..20, 0..20) == Band::Cut(2));
        assert!(cell(&map, 20..40, 0..20) == Band::Uncut);
        let picture = drawing(&map).to_string();
        let drawn: Vec<_> = Band::all()
            .map(Band::colour)
            .filter(|colour| picture.contains(&format!("stroke=\"{colour}\"")))
            .collect();
        assert_eq!(drawn, [Band::Cut(2).colour(), UNCUT]);
    }

    /// Bands are wide enough for the largest deviation and not twice too wide.
    #[test]
    fn bands_hold_the_largest() {
        for largest in [0.0004, 0.011, 0.021, 0.055, 3.1, 2.75] {
            let band = band_for(largest);
            let reach = band * (f64::from(SIDES) + 0.5);
            assert!(reach >= largest * (1.0 - 1e-9), "{largest} {band}");
            assert!(reach <= largest * 2.1, "{largest} {band}");
        }
    }
}
