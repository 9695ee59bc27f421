//! The path over the part, from one side.

use crate::draw::labels::Labels;
use crate::draw::markup::{Element, el};
use crate::draw::scale::{PlanView, bar, nice_below};
use crate::draw::svg::{picture, px};

use super::{PlanRow, SeenPoint};

const SIZE: [f64; 2] = [900.0, 560.0];
const MAP: [f64; 2] = [900.0, 530.0];
const MARGIN: f64 = 40.0;
/// Length of a spoke that looks across, in px.
const SPOKE: f64 = 26.0;
/// Spokes at most.
const SPOKES: usize = 400;

/// A side from which the path is looked at.
pub struct PlanSide {
    /// "From above".
    pub name: &'static str,
    /// What points to the right, and up.
    pub axes: &'static str,
    flat: [usize; 2],
    /// What looks to us: an axis and its sense.
    to_us: (usize, f64),
}

/// The sides of a page.
pub const SIDES: [PlanSide; 3] = [
    PlanSide {
        name: "From above",
        axes: "X to the right, Y up",
        flat: [0, 1],
        to_us: (2, 1.0),
    },
    PlanSide {
        name: "From the front",
        axes: "X to the right, Z up",
        flat: [0, 2],
        to_us: (1, -1.0),
    },
    PlanSide {
        name: "From the right",
        axes: "Y to the right, Z up",
        flat: [1, 2],
        to_us: (0, 1.0),
    },
];

/// The drawing.
pub fn drawing(side: &PlanSide, rows: &[PlanRow], seen: &[SeenPoint]) -> Element {
    let flat = |p: &[f64; 3]| side.flat.map(|i| p[i]);
    let all: Vec<[f64; 2]> = rows
        .iter()
        .filter(|row| row.laser)
        .map(|row| flat(&row.tip_mm))
        .chain(seen.iter().map(|s| flat(&s.at_mm)))
        .collect();
    let plan = PlanView::fit(&all, [0.0, 0.0], MAP, MARGIN);
    let place = |p: &[f64; 3]| {
        let [x, y] = flat(p);
        plan.at(x, y)
    };
    let (axis, sense) = side.to_us;
    let faces = |s: &&SeenPoint| s.normal[axis] * sense > 0.02;
    let (mut once, mut more, mut never) = (String::new(), String::new(), String::new());
    for s in seen.iter().filter(faces) {
        let [x, y] = place(&s.at_mm);
        match s.passes {
            0 => {
                never += &format!("M{} {}l5 5m0 -5l-5 5", px(x - 2.5), px(y - 2.5));
            }
            1 => once += &format!("M{} {}h0", px(x), px(y)),
            _ => {
                more += &format!(
                    "M{} {}a1.4 1.4 0 1 0 2.8 0a1.4 1.4 0 1 0 -2.8 0",
                    px(x - 1.4),
                    px(y)
                )
            }
        }
    }
    let path = |d: &str, stroke: &str, width: f64| {
        el("path")
            .attr("d", d)
            .attr("fill", "none")
            .attr("stroke", stroke)
            .attr("stroke-width", width)
            .attr("stroke-linecap", "round")
    };
    let mut out = picture(SIZE[0], SIZE[1], &format!("{}: {}", side.name, side.axes))
        .child(path(&once, "var(--muted)", 1.8))
        .child(path(&more, "var(--blue)", 0.6))
        .child(path(&never, "var(--ng)", 1.2));
    let (mut passes, mut links, mut spokes) = (String::new(), String::new(), String::new());
    let mut labels = Labels::new([0.0, 0.0], MAP);
    let mut starts = Vec::new();
    let on = rows.iter().filter(|row| row.laser).count();
    let every = on.div_ceil(SPOKES).max(4);
    let mut before: Option<&PlanRow> = None;
    for (k, row) in rows.iter().enumerate() {
        let [x, y] = place(&row.tip_mm);
        let goes_on = before.is_some_and(|b| b.laser && row.laser && b.pass == row.pass);
        if let Some(b) = before {
            let [u, v] = place(&b.tip_mm);
            let way = if goes_on { &mut passes } else { &mut links };
            *way += &format!("M{} {}L{} {}", px(u), px(v), px(x), px(y));
        }
        if row.laser && !goes_on {
            starts.push(([x, y], row.pass));
        }
        if row.laser && k % every == 0 {
            let [u, v] = side.flat.map(|i| -row.beam[i] * SPOKE);
            spokes += &format!("M{} {}L{} {}", px(x), px(y), px(x + u), px(y - v));
        }
        before = Some(row);
    }
    out = out
        .child(path(&links, "var(--muted)", 0.9).attr("stroke-dasharray", "4 3"))
        .child(path(&spokes, "var(--purple)", 0.8))
        .child(path(&passes, "var(--ink)", 1.8));
    for (at, number) in starts {
        out = out.child(labels.place("t b", at, 4.0, &number.to_string()));
    }
    let length = nice_below(MAP[0] / 4.0 / plan.scale);
    out.children(bar("bar", [12.0, SIZE[1] - 12.0], length, plan.scale))
}
