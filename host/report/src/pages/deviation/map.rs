//! A map of deviations as one side of the part shows them.

use crate::draw::markup::{Element, el};
use crate::draw::scale::{PlanView, bar, nice_below};
use crate::draw::svg::{circle, line, picture, px, text, text_width};

use super::bands::{BANDS, Bands, COLOURS, stroke_path, strokes};
use super::{DeviationPoint, MarkedSpot};

/// A side from which a part is looked at.
pub struct PartSide {
    /// "From above".
    pub name: &'static str,
    /// What points to the right, and up.
    pub axes: &'static str,
    right: [f64; 3],
    up: [f64; 3],
}

/// The six sides.
pub const SIDES: [PartSide; 6] = [
    PartSide {
        name: "From above",
        axes: "X to the right, Y up",
        right: [1.0, 0.0, 0.0],
        up: [0.0, 1.0, 0.0],
    },
    PartSide {
        name: "From the front",
        axes: "X to the right, Z up",
        right: [1.0, 0.0, 0.0],
        up: [0.0, 0.0, 1.0],
    },
    PartSide {
        name: "From the right",
        axes: "Y to the right, Z up",
        right: [0.0, 1.0, 0.0],
        up: [0.0, 0.0, 1.0],
    },
    PartSide {
        name: "From the back",
        axes: "X to the left, Z up",
        right: [-1.0, 0.0, 0.0],
        up: [0.0, 0.0, 1.0],
    },
    PartSide {
        name: "From the left",
        axes: "Y to the left, Z up",
        right: [0.0, -1.0, 0.0],
        up: [0.0, 0.0, 1.0],
    },
    PartSide {
        name: "From below",
        axes: "X to the right, Y down",
        right: [1.0, 0.0, 0.0],
        up: [0.0, -1.0, 0.0],
    },
];

const SIZE: [f64; 2] = [640.0, 440.0];
/// What the map itself takes of the picture; the legend stands beside it.
const MAP: [f64; 2] = [540.0, 402.0];
const MARGIN: f64 = 10.0;
/// A cell of the map, in px.
const CELL: f64 = 6.0;
/// A surface that leans by more than this cosine is not of this side.
const LEANS: f64 = 0.1;

/// A map, and of how many points.
pub struct SideMap {
    /// The drawing.
    pub drawing: Element,
    /// Points that it shows.
    pub shown: usize,
    /// The length of a cell in mm.
    pub cell_mm: f64,
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// The mean deviation of each cell: its uppermost points count, those within two cells of the highest. None where no
/// point's surface looks to this side.
pub fn map(
    side: &PartSide,
    points: &[DeviationPoint],
    bands: &Bands,
    spots: &[MarkedSpot],
) -> Option<SideMap> {
    let to_us = cross(side.right, side.up);
    let faces =
        |p: &&DeviationPoint| p.outward == [0.0; 3] || dot(p.outward.map(f64::from), to_us) > LEANS;
    let flat = |p: &DeviationPoint| [dot(p.at_mm, side.right), dot(p.at_mm, side.up)];
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let mut count = 0_usize;
    for p in points.iter().filter(faces) {
        count += 1;
        for (i, v) in flat(p).into_iter().enumerate() {
            low[i] = low[i].min(v);
            high[i] = high[i].max(v);
        }
    }
    if count == 0 {
        return None;
    }
    let plan = PlanView::fit(&[low, high], [0.0, 0.0], MAP, MARGIN);
    let cell_mm = CELL / plan.scale;
    let [columns, rows] = MAP.map(|size| (size / CELL).ceil() as usize);
    let cell = |p: &DeviationPoint| {
        let [x, y] = flat(p);
        let [x, y] = plan.at(x, y);
        let column = ((x / CELL) as usize).min(columns - 1);
        let row = ((y / CELL) as usize).min(rows - 1);
        row * columns + column
    };
    let mut highest = vec![f64::NEG_INFINITY; columns * rows];
    for p in points.iter().filter(faces) {
        let place = cell(p);
        highest[place] = highest[place].max(dot(p.at_mm, to_us));
    }
    let mut sums = vec![(0_u32, 0.0_f64); columns * rows];
    let mut shown = 0;
    for p in points.iter().filter(faces) {
        let place = cell(p);
        if dot(p.at_mm, to_us) >= highest[place] - 2.0 * cell_mm {
            sums[place].0 += 1;
            sums[place].1 += p.deviation_mm;
            shown += 1;
        }
    }
    let band = |place: usize| {
        (sums[place].0 > 0).then(|| bands.of(sums[place].1 / f64::from(sums[place].0)))
    };
    let mut fills: [String; BANDS] = Default::default();
    let mut marks: [String; BANDS] = Default::default();
    for row in 0..rows {
        let mut column = 0;
        while column < columns {
            let Some(of) = band(row * columns + column) else {
                column += 1;
                continue;
            };
            let first = column;
            while column < columns && band(row * columns + column) == Some(of) {
                let at = [(column as f64 + 0.5) * CELL, (row as f64 + 0.5) * CELL];
                marks[of] += &strokes(of, at, CELL * 0.62).unwrap_or_default();
                column += 1;
            }
            let width = (column - first) as f64 * CELL;
            fills[of] += &format!(
                "M{} {}h{}v{CELL}h-{}z",
                px(first as f64 * CELL),
                px(row as f64 * CELL),
                px(width),
                px(width)
            );
        }
    }
    let label = format!(
        "{}: {}; mean deviation of each cell in {}",
        side.name,
        side.axes,
        bands.unit().0
    );
    let mut out = picture(SIZE[0], SIZE[1], &label);
    for (of, d) in fills.iter().enumerate().filter(|(_, d)| !d.is_empty()) {
        out = out.child(
            el("path")
                .attr("d", d)
                .attr("fill", COLOURS[of])
                .attr("shape-rendering", "crispEdges"),
        );
    }
    for (of, d) in marks.iter().enumerate().filter(|(_, d)| !d.is_empty()) {
        out = out.child(stroke_path(of, d));
    }
    for spot in spots.iter().filter(|spot| faces(&&spot.of)) {
        let [x, y] = flat(&spot.of);
        out = out.children(marked(plan.at(x, y), &spot.says));
    }
    let length = nice_below(MAP[0] / 4.0 / plan.scale);
    let base = SIZE[1] - 14.0;
    out = out
        .children(bar("bar", [12.0, base], length, plan.scale))
        .child(text("t muted", [230.0, base + 4.0], side.axes))
        .children(bands.legend([MAP[0] + 16.0, 24.0]));
    Some(SideMap {
        drawing: out,
        shown,
        cell_mm,
    })
}

/// A ring with a cross about a place, and words on that side of it where they have room, above it or below.
fn marked([x, y]: [f64; 2], says: &str) -> Vec<Element> {
    const RING: f64 = 8.0;
    let wide = text_width("t b", says);
    let left = (x - wide / 2.0).clamp(2.0, (MAP[0] - wide).max(2.0));
    let base = if y > 3.0 * RING {
        y - RING - 6.0
    } else {
        y + RING + 14.0
    };
    vec![
        circle("spot", [x, y], RING),
        line("spot", [x - 1.5 * RING, y], [x + 1.5 * RING, y]),
        line("spot", [x, y - 1.5 * RING], [x, y + 1.5 * RING]),
        text("t b halo", [left, base], says),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(at_mm: [f64; 3], deviation_mm: f64, outward: [f32; 3]) -> DeviationPoint {
        DeviationPoint {
            at_mm,
            deviation_mm,
            outward,
        }
    }

    /// What lies behind is not mixed into what lies in front, and each side shows its own.
    #[test]
    fn a_side_shows_what_faces_it_and_lies_in_front() {
        let bands = Bands {
            low_mm: -0.1,
            high_mm: 0.1,
        };
        let up = [0.0, 0.0, 1.0];
        let points = [
            point([0.0, 0.0, 50.0], 0.5, up),
            point([0.0, 0.0, 0.0], -0.5, up),
            point([100.0, 0.0, 50.0], 0.0, up),
            point([50.0, 0.0, 0.0], -0.5, [0.0, 0.0, -1.0]),
        ];
        let above = map(&SIDES[0], &points, &bands, &[]).unwrap();
        assert_eq!(above.shown, 2);
        let text = above.drawing.to_string();
        // The cell above the limits, the middle, and the legend; none below the limits but in the legend.
        assert_eq!(
            text.matches(&format!("\"{}\"", COLOURS[8])).count(),
            2,
            "{text}"
        );
        assert_eq!(text.matches(&format!("\"{}\"", COLOURS[4])).count(), 2);
        assert_eq!(text.matches(&format!("\"{}\"", COLOURS[0])).count(), 1);
        let below = map(&SIDES[5], &points, &bands, &[]).unwrap();
        assert_eq!(below.shown, 1);
        assert!(map(&SIDES[1], &points, &bands, &[]).is_none());
    }

    /// A spot is marked where its surface is seen, with its words inside of the picture.
    #[test]
    fn a_spot_is_marked_on_its_side() {
        let bands = Bands::default();
        let up = [0.0, 0.0, 1.0];
        let points = [
            point([0.0, 0.0, 0.0], 0.5, up),
            point([100.0, 0.0, 0.0], 0.0, up),
            point([50.0, 0.0, -9.0], 0.0, [0.0, 0.0, -1.0]),
        ];
        let spots = points[..2].iter().map(|of| MarkedSpot {
            of: *of,
            says: "least 0.1612 mm at 41.545, -0.082, 10.851".into(),
        });
        let spots: Vec<MarkedSpot> = spots.collect();
        let above = map(&SIDES[0], &points, &bands, &spots).unwrap();
        let text = above.drawing.to_string();
        assert_eq!(text.matches("least 0.1612 mm").count(), 2, "{text}");
        let below = map(&SIDES[5], &points, &bands, &spots).unwrap();
        assert!(!below.drawing.to_string().contains("least"));
    }

    /// The ball of an axis' residual has no side: each map shows it.
    #[test]
    fn what_has_no_side_is_on_each() {
        let bands = Bands {
            low_mm: -0.1,
            high_mm: 0.1,
        };
        let balls = [point([0.0, 0.0, 50.0], 0.5, [0.0; 3])];
        for side in &SIDES {
            assert_eq!(map(side, &balls, &bands, &[]).unwrap().shown, 1);
        }
    }
}
