//! A setup in plan: its datum features, nominal and measured, and the part before and after
//! the correction.

use umi_protocol::job::FeatureSpec;

use crate::draw::labels::Labels;
use crate::draw::markup::Element;
use crate::draw::scale::{Magnified, PlanView, bar, ticks};
use crate::draw::svg::{arrow, circle, cross, line, picture, polygon, rect, text};
use crate::figures::{Vector, motion, part_outline, transform};
use umi_client::session::{Session, Setup, datums};
const WIDTH: f64 = 450.0;
const HEIGHT: f64 = 420.0;
/// The drawing area's corner and size.
const CORNER: [f64; 2] = [44.0, 10.0];
const SIZE: [f64; 2] = [396.0, 336.0];
/// A displacement shorter than this on the page is magnified.
const VISIBLE: f64 = 14.0;

/// A datum feature on the page.
struct Datum<'a> {
    spec: &'a FeatureSpec,
    reference: Option<Vector>,
    measured: Option<Vector>,
    /// Fitted but refused.
    refused: Option<Vector>,
}

/// A setup's picture, and what its caption says.
pub fn drawing(session: &Session, place: usize) -> Option<(Element, String)> {
    let setup = session.setups.get(place)?;
    let datums = collect(session, setup, place);
    let outlines = Outlines::new(session, setup);
    let largest = datums.iter().filter_map(Datum::moved).fold(0.0, f64::max);
    // Whether displacements can be seen true to scale depends on the scale.
    let true_plan = fit(&datums, &outlines, 1.0)?;
    let shown = displacement_scale(largest, true_plan.scale);
    let plan = fit(&datums, &outlines, shown.times)?;
    let label = format!(
        "{}: the setup in plan, nominal and measured",
        setup.heading()
    );
    let far = [CORNER[0] + SIZE[0], CORNER[1] + SIZE[1]];
    let mut labels = Labels::new(CORNER, far);
    let mut svg = picture(WIDTH, HEIGHT, &label).children(frame(&plan));
    svg = svg.children(outlines.draw(&plan, shown.times, &mut labels));
    for datum in &datums {
        svg = svg.children(datum.draw(&plan, shown.times, &mut labels));
    }
    for datum in &datums {
        svg = svg.children(datum.name(&plan, shown.times, &mut labels));
    }
    let svg = svg.children(legend(&outlines, &plan));
    Some((svg, caption(setup, &datums, &outlines, largest, shown)))
}

/// The plan that shows everything with displacements so many times magnified.
fn fit(datums: &[Datum<'_>], outlines: &Outlines, times: f64) -> Option<PlanView> {
    let mut extent: Vec<[f64; 2]> = outlines.all(times);
    for datum in datums {
        let r = ball_radius(datum.spec);
        for [x, y] in [datum.reference.map(flat), datum.shown(times)]
            .into_iter()
            .flatten()
        {
            extent.extend([[x - r, y - r], [x + r, y + r]]);
        }
    }
    (!extent.is_empty()).then(|| PlanView::fit(&extent, CORNER, SIZE, 22.0))
}

fn flat(p: Vector) -> [f64; 2] {
    [p[0], p[1]]
}

/// Where a point that belongs at `from` and is at `to` is shown.
fn displaced(from: Vector, to: Vector, times: f64) -> [f64; 2] {
    std::array::from_fn(|i| from[i] + (to[i] - from[i]) * times)
}

fn collect<'a>(session: &'a Session, setup: &Setup, place: usize) -> Vec<Datum<'a>> {
    let reference = session.reference_mm(place);
    datums(&session.job)
        .enumerate()
        .map(|(i, spec)| Datum {
            spec,
            reference: reference.as_ref().and_then(|r| r.get(i).copied()),
            measured: setup.position_mm(&spec.name),
            refused: setup
                .feature(&spec.name)
                .filter(|f| !f.is_ok())
                .and_then(|f| f.fit.as_ref()?.shape.position_mm()),
        })
        .collect()
}

/// Displacements true to scale where they can be seen so.
fn displacement_scale(largest_mm: f64, scale: f64) -> Magnified {
    if largest_mm * scale >= VISIBLE || largest_mm <= 0.0 {
        Magnified {
            times: 1.0,
            px_per_mm: scale,
        }
    } else {
        Magnified::for_largest(largest_mm, VISIBLE * 3.0, scale)
    }
}

fn ball_radius(spec: &FeatureSpec) -> f64 {
    spec.radius_mm.filter(|r| r.is_finite()).unwrap_or(5.0)
}

impl Datum<'_> {
    /// How far it moved in plan, mm.
    fn moved(&self) -> Option<f64> {
        let (from, to) = (self.reference?, self.measured?);
        let moved = (to[0] - from[0]).hypot(to[1] - from[1]);
        moved.is_finite().then_some(moved)
    }

    /// Where it is shown if it was measured.
    fn shown(&self, times: f64) -> Option<[f64; 2]> {
        let to = self.measured?;
        Some(
            self.reference
                .map_or(flat(to), |from| displaced(from, to, times)),
        )
    }

    fn draw(&self, plan: &PlanView, times: f64, labels: &mut Labels) -> Vec<Element> {
        let r = ball_radius(self.spec) * plan.scale;
        let mut out = Vec::new();
        let nominal = self.reference.map(|p| plan.at(p[0], p[1]));
        if let Some(at) = nominal {
            out.push(circle("nominal", at, r));
            out.push(line(
                "nominal-cross",
                [at[0] - 4.0, at[1]],
                [at[0] + 4.0, at[1]],
            ));
            out.push(line(
                "nominal-cross",
                [at[0], at[1] - 4.0],
                [at[0], at[1] + 4.0],
            ));
            labels.keep_off(at, r);
        }
        if let Some([x, y]) = self.shown(times) {
            let at = plan.at(x, y);
            out.push(circle("measured", at, r));
            labels.keep_off(at, r);
            if let Some(from) = nominal.filter(|from| *from != at) {
                out.extend(arrow("moved", from, at));
                labels.keep_off_line(from, at);
            }
        } else if let Some(at) = self.refused.map(|p| plan.at(p[0], p[1])).or(nominal) {
            // Where it is not known where the feature is, its nominal place is crossed out.
            out.extend(cross("wrong", at, r.max(6.0)));
        }
        out
    }

    fn name(&self, plan: &PlanView, times: f64, labels: &mut Labels) -> Option<Element> {
        let [x, y] = self
            .shown(times)
            .or_else(|| self.refused.or(self.reference).map(flat))?;
        let beside = ball_radius(self.spec) * plan.scale + 3.0;
        Some(if self.measured.is_some() {
            labels.place("t b", plan.at(x, y), beside, &self.spec.name)
        } else {
            let says = format!("{} not usable", self.spec.name);
            labels.place("t b ng", plan.at(x, y), beside, &says)
        })
    }
}

/// The part as programmed, as registered, and as the correction program puts it.
struct Outlines {
    programmed: Option<[Vector; 4]>,
    registered: Option<[Vector; 4]>,
    corrected: Option<[Vector; 4]>,
}

impl Outlines {
    fn new(session: &Session, setup: &Setup) -> Self {
        let programmed = part_outline(session);
        let registration = setup.verdict.registration.as_ref();
        let finite = |c: &[Vector; 4]| c.iter().flatten().all(|x| x.is_finite());
        Self {
            programmed,
            registered: programmed
                .zip(registration)
                .map(|(c, r)| c.map(|p| transform(&r.rotation, r.translation_mm, p)))
                .filter(finite),
            corrected: programmed
                .zip(motion(session, setup))
                .map(|(c, m)| c.map(|p| m.apply(p)))
                .filter(finite),
        }
    }

    /// The displaced outline that is shown, if any, and its class.
    fn displaced(&self, times: f64) -> Option<(&'static str, [[f64; 2]; 4])> {
        let (class, to) = match (self.corrected, self.registered) {
            (Some(to), _) => ("outline corrected", to),
            (None, Some(to)) => ("outline registered", to),
            (None, None) => return None,
        };
        let from = self.programmed?;
        Some((
            class,
            std::array::from_fn(|i| displaced(from[i], to[i], times)),
        ))
    }

    fn all(&self, times: f64) -> Vec<[f64; 2]> {
        let programmed = self.programmed.iter().flatten().map(|p| flat(*p));
        let displaced = self.displaced(times);
        programmed
            .chain(displaced.iter().flat_map(|(_, corners)| *corners))
            .collect()
    }

    fn draw(&self, plan: &PlanView, times: f64, labels: &mut Labels) -> Vec<Element> {
        let programmed = self.programmed.map(|c| ("outline programmed", c.map(flat)));
        let mut out = Vec::new();
        for (class, corners) in [self.displaced(times), programmed].into_iter().flatten() {
            let corners = corners.map(|[x, y]| plan.at(x, y));
            out.push(polygon(class, &corners));
            for (i, from) in corners.iter().enumerate() {
                labels.keep_off_line(*from, corners[(i + 1) % 4]);
            }
        }
        out
    }
}

/// The frame with ticks in mm.
fn frame(plan: &PlanView) -> Vec<Element> {
    let far = [CORNER[0] + SIZE[0], CORNER[1] + SIZE[1]];
    let low = plan.data_at([CORNER[0], far[1]]);
    let high = plan.data_at([far[0], CORNER[1]]);
    let mut out = Vec::new();
    for x in ticks(low[0], high[0], 6) {
        let [at, _] = plan.at(x, 0.0);
        out.push(line("grid", [at, CORNER[1]], [at, far[1]]));
        out.push(text("t muted mid", [at, far[1] + 14.0], &format!("{x:.0}")));
    }
    for y in ticks(low[1], high[1], 6) {
        let [_, at] = plan.at(0.0, y);
        out.push(line("grid", [CORNER[0], at], [far[0], at]));
        out.push(text(
            "t muted end",
            [CORNER[0] - 5.0, at + 4.0],
            &format!("{y:.0}"),
        ));
    }
    out.push(rect("frame", CORNER, far));
    out.push(text("t muted end", [far[0], far[1] + 27.0], "X, mm"));
    out.push(text("t muted", [4.0, CORNER[1] + 8.0], "Y, mm"));
    out
}

fn legend(outlines: &Outlines, plan: &PlanView) -> Vec<Element> {
    let y = HEIGHT - 30.0;
    let x = CORNER[0];
    let mut out = vec![
        circle("nominal", [x + 6.0, y], 6.0),
        text("t", [x + 18.0, y + 4.0], "nominal"),
        circle("measured", [x + 84.0, y], 6.0),
        text("t", [x + 96.0, y + 4.0], "measured"),
    ];
    out.extend(bar(
        "bar",
        [x + 280.0, y],
        Magnified {
            times: 1.0,
            px_per_mm: plan.scale,
        }
        .bar_mm(70.0),
        plan.scale,
    ));
    if outlines.programmed.is_some() {
        out.push(line(
            "outline programmed",
            [x, y + 20.0],
            [x + 18.0, y + 20.0],
        ));
        out.push(text("t", [x + 24.0, y + 24.0], "part as programmed"));
    }
    let Some((class, _)) = outlines.displaced(1.0) else {
        return out;
    };
    let says = if outlines.corrected.is_some() {
        "where the corrected program cuts"
    } else {
        "part as registered, not corrected"
    };
    out.push(line(class, [x + 160.0, y + 20.0], [x + 178.0, y + 20.0]));
    out.push(text("t", [x + 184.0, y + 24.0], says));
    out
}

fn caption(
    setup: &Setup,
    datums: &[Datum<'_>],
    outlines: &Outlines,
    largest_mm: f64,
    shown: Magnified,
) -> String {
    let mut says = String::from("The setup in plan. ");
    if datums.iter().any(|d| d.measured.is_none()) {
        says.push_str("Crosses: features that are missing or refused. ");
    }
    if setup.is_taught() {
        says.push_str(
            "This clamping is the reference: what is measured here is nominal for the others.",
        );
        return says;
    }
    if datums.iter().any(|d| d.moved().is_some()) {
        says.push_str(&format!(
            "Displacements from nominal (arrows, up to {largest_mm:.3} mm) are drawn {}. ",
            shown.stated()
        ));
    }
    says.push_str(if outlines.corrected.is_some() {
        "Look for the solid outline standing among the measured features as the dashed one stands among the nominal."
    } else {
        "There is no corrected outline, because no correction was cleared."
    });
    says
}
