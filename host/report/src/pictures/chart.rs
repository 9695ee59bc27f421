//! The summary over all clampings: what the limits look at, with the limits.

use crate::draw::markup::Element;
use crate::draw::number::{fixed, um, um_signed};
use crate::draw::scale::ticks;
use crate::draw::svg::{line, mark, picture, rect, text, text_width};
use crate::figures::{extreme, largest, point_errors, radius_error};
use umi_client::session::{Session, Setup};

const WIDTH: f64 = 920.0;
const PANEL: f64 = 460.0;
/// Height of a panel without the lines of its legend.
const BODY: f64 = 202.0;
/// A line of the legend.
const LINE: f64 = 16.0;
const LEGEND_WIDTH: f64 = 440.0;
/// Room for a mark and the gap to the next name.
const LEGEND_MARK: f64 = 26.0;
/// Inside a panel: left, top, right, bottom.
const AREA: [f64; 4] = [52.0, 26.0, 450.0, 168.0];
/// Values beyond this many limits are drawn at the edge, with their figure.
const EDGE: f64 = 1.6;

/// One of the panels.
struct Panel {
    title: &'static str,
    limit_mm: f64,
    /// Deviations have a sign, and a limit on both sides.
    both_sides: bool,
    series: Vec<Series>,
}

/// One value per clamping.
struct Series {
    name: String,
    values_mm: Vec<Value>,
}

#[derive(Clone, Copy)]
enum Value {
    Known(f64),
    /// Fitted, but the feature was refused all the same.
    Doubtful(f64),
    /// The feature was refused or did not come.
    Refused,
    /// There is nothing to compare with.
    Absent,
}

impl Value {
    fn of(value: Option<f64>) -> Self {
        value
            .filter(|v| v.is_finite())
            .map_or(Self::Absent, Self::Known)
    }
}

/// The chart, and what its caption says.
pub fn drawing(session: &Session) -> (Element, String) {
    let panels = [
        per_feature(
            session,
            "radius error, \u{b5}m",
            session.job.limits.radius_error_mm,
            true,
        ),
        per_feature(
            session,
            "rms of residuals, \u{b5}m",
            session.job.limits.rms_mm,
            false,
        ),
        distances(session),
        registration(session),
    ];
    let lines = panels.iter().map(|p| p.legend_lines().len()).max();
    let height = BODY + LINE * whole(lines.unwrap_or(1));
    let mut svg = picture(
        WIDTH,
        height * 2.0,
        "Radius error, rms, distance errors and registration of all clampings against their limits",
    );
    for (i, panel) in (0u8..).zip(&panels) {
        let corner = [PANEL * f64::from(i % 2), height * f64::from(i / 2)];
        svg = svg.children(panel.draw(session, corner));
    }
    let caption = "Every clamping against the limits of the job (dashed, shaded beyond). Look for \
        marks near or beyond a dashed line, and for a step from one clamping to the next: the \
        spheres stay the same, so their radius error should too. A cross: refused \
        or missing, no figure; a ring: a figure of a refused feature; a mark at the edge lies beyond it."
        .into();
    (svg, caption)
}

/// Radius error or rms of every feature.
fn per_feature(session: &Session, title: &'static str, limit_mm: f64, radius: bool) -> Panel {
    let series = session
        .job
        .features
        .iter()
        .filter(|spec| !radius || spec.radius_mm.is_some())
        .map(|spec| {
            let value = |setup: &Setup| match setup.feature(&spec.name) {
                None => Value::Refused,
                Some(feature) => match &feature.fit {
                    None => Value::Refused,
                    Some(fit) => {
                        let value = if radius {
                            radius_error(Some(spec), fit)
                        } else {
                            Some(fit.rms_mm)
                        };
                        match value.filter(|v| v.is_finite()) {
                            Some(value) if !feature.is_ok() => Value::Doubtful(value),
                            value => Value::of(value),
                        }
                    }
                },
            };
            Series {
                name: spec.name.to_string(),
                values_mm: session.setups.iter().map(value).collect(),
            }
        })
        .collect();
    Panel {
        title,
        limit_mm,
        both_sides: radius,
        series,
    }
}

fn distances(session: &Session) -> Panel {
    let mut pairs: Vec<(&str, &str)> = Vec::new();
    for d in session.setups.iter().flat_map(|p| &p.verdict.distances) {
        if !pairs.contains(&(&d.a, &d.b)) {
            pairs.push((&d.a, &d.b));
        }
    }
    let value = |setup: &Setup, a: &str, b: &str| {
        let found = setup
            .verdict
            .distances
            .iter()
            .find(|d| d.a == a && d.b == b);
        match found {
            None => Value::Refused,
            Some(d) => Value::of(d.reference_mm.map(|r| d.measured_mm - r)),
        }
    };
    Panel {
        title: "distance errors, \u{b5}m",
        limit_mm: session.job.limits.distance_error_mm,
        both_sides: true,
        series: pairs
            .into_iter()
            .map(|(a, b)| Series {
                name: format!("{a}\u{2013}{b}"),
                values_mm: session.setups.iter().map(|p| value(p, a, b)).collect(),
            })
            .collect(),
    }
}

fn registration(session: &Session) -> Panel {
    let rms = |setup: &Setup| match &setup.verdict.registration {
        Some(registration) => Value::of(Some(registration.rms_mm)),
        None if setup.is_taught() => Value::Absent,
        None => Value::Refused,
    };
    let mut series = vec![Series {
        name: "registration rms".into(),
        values_mm: session.setups.iter().map(rms).collect(),
    }];
    if session.setups.iter().any(|p| p.truth.is_some()) {
        let path = |setup: &Setup| {
            setup.truth.map_or(Value::Absent, |_| {
                let errors = point_errors(session, setup);
                Value::of(largest(errors.iter().map(|e| e.registration_mm)))
            })
        };
        series.push(Series {
            name: "largest path error (known truth; no limit)".into(),
            values_mm: session.setups.iter().map(path).collect(),
        });
    }
    Panel {
        title: "registration, \u{b5}m",
        limit_mm: session.job.limits.registration_rms_mm,
        both_sides: false,
        series,
    }
}

impl Panel {
    /// The largest value that the panel shows at its place.
    fn edge(&self) -> f64 {
        let values = self.series.iter().flat_map(|s| &s.values_mm);
        let known = values.filter_map(|v| match v {
            Value::Known(mm) | Value::Doubtful(mm) => Some(*mm),
            _ => None,
        });
        let limit = self.limit_mm.abs().max(1e-5);
        let most = extreme(known).map_or(0.0, f64::abs) * 1.1;
        most.clamp(limit * 1.25, limit * EDGE)
    }

    fn draw(&self, session: &Session, corner: [f64; 2]) -> Vec<Element> {
        let [left, right] = [AREA[0] + corner[0], AREA[2] + corner[0]];
        let [top, bottom] = [AREA[1] + corner[1], AREA[3] + corner[1]];
        let edge = self.edge();
        let low = if self.both_sides { -edge } else { 0.0 };
        let y = |mm: f64| bottom - (mm - low) / (edge - low) * (bottom - top);
        let mut out = vec![text("t b", [left - 44.0, top - 10.0], self.title)];
        let limits = if self.both_sides {
            vec![self.limit_mm, -self.limit_mm]
        } else {
            vec![self.limit_mm]
        };
        for limit in &limits {
            let outer = if *limit < 0.0 { bottom } else { top };
            out.push(rect("beyond", [left, y(*limit)], [right, outer]));
        }
        for tick in ticks(low * 1e3, edge * 1e3, 6) {
            let at = y(tick / 1e3);
            let value = tick_text(tick, self.both_sides);
            out.push(line("grid", [left, at], [right, at]));
            out.push(text("t muted end", [left - 5.0, at + 4.0], &value));
        }
        for limit in limits {
            let says = if limit < 0.0 {
                String::new()
            } else {
                format!("limit {}", um(limit))
            };
            out.push(line("limit", [left, y(limit)], [right, y(limit)]));
            out.push(text("t muted end", [right - 3.0, y(limit) - 4.0], &says));
        }
        out.extend(self.marks(session, [left, right], [top, bottom], &y, edge));
        out.push(line("axis", [left, y(0.0)], [right, y(0.0)]));
        out.push(rect("frame", [left, top], [right, bottom]));
        out.extend(self.legend([left - 40.0, bottom + 32.0]));
        out
    }

    fn marks(
        &self,
        session: &Session,
        [left, right]: [f64; 2],
        [top, bottom]: [f64; 2],
        y: &impl Fn(f64) -> f64,
        edge: f64,
    ) -> Vec<Element> {
        let mut out = Vec::new();
        let pitch = (right - left) / whole(session.setups.len().max(1));
        let every = session.setups.len().div_ceil(7).max(1);
        let spread = (pitch * 0.5 / whole(self.series.len().max(1))).min(16.0);
        for (p, setup) in session.setups.iter().enumerate() {
            let middle = left + pitch * (whole(p) + 0.5);
            if p > 0 {
                let between = left + pitch * whole(p);
                out.push(line("grid", [between, top], [between, bottom]));
            }
            if p.is_multiple_of(every) {
                out.push(text(
                    "t muted mid",
                    [middle, bottom + 14.0],
                    &setup.heading(),
                ));
            }
            for (s, series) in self.series.iter().enumerate() {
                let x = middle + (whole(s) - whole(self.series.len() - 1) / 2.0) * spread;
                let value = series.values_mm.get(p).copied().unwrap_or(Value::Absent);
                if let Value::Doubtful(mm) = value {
                    let at = y(mm.clamp(-edge, edge));
                    out.push(crate::draw::svg::circle("accused", [x, at], 8.0));
                }
                match value {
                    Value::Known(mm) | Value::Doubtful(mm) if mm.abs() <= edge => {
                        out.push(mark("", s, [x, y(mm)], 4.0));
                    }
                    Value::Known(mm) | Value::Doubtful(mm) => {
                        let at = if mm < 0.0 { bottom - 5.0 } else { top + 5.0 };
                        let says = if self.both_sides {
                            um_signed(mm)
                        } else {
                            um(mm)
                        };
                        out.push(mark(" out", s, [x, at], 4.0));
                        out.push(text(
                            "t ng mid",
                            [x, at + if mm < 0.0 { -8.0 } else { 16.0 }],
                            &says,
                        ));
                    }
                    Value::Refused => {
                        out.extend(crate::draw::svg::cross("wrong", [x, y(0.0)], 4.0));
                    }
                    Value::Absent => {}
                }
            }
        }
        out
    }

    /// Names of the series in lines that do not run into the next panel.
    fn legend_lines(&self) -> Vec<Vec<usize>> {
        let mut lines: Vec<Vec<usize>> = vec![Vec::new()];
        let mut x = 0.0;
        for (s, series) in self.series.iter().enumerate() {
            let width = LEGEND_MARK + text_width("t", &series.name);
            if x > 0.0 && x + width > LEGEND_WIDTH {
                lines.push(Vec::new());
                x = 0.0;
            }
            x += width;
            if let Some(line) = lines.last_mut() {
                line.push(s);
            }
        }
        lines
    }

    fn legend(&self, corner: [f64; 2]) -> Vec<Element> {
        let mut out = Vec::new();
        let mut y = corner[1];
        for line in self.legend_lines() {
            let mut x = corner[0];
            for s in line {
                let name = &self.series[s].name;
                out.push(mark("", s, [x + 6.0, y - 4.0], 4.0));
                out.push(text("t", [x + 14.0, y], name));
                x += LEGEND_MARK + text_width("t", name);
            }
            y += LINE;
        }
        out
    }
}

fn tick_text(um: f64, both_sides: bool) -> String {
    let decimals = usize::from(um.fract().abs() > 1e-9);
    if both_sides {
        crate::draw::number::signed(um, decimals)
    } else {
        fixed(um, decimals)
    }
}

#[allow(clippy::cast_precision_loss, reason = "counts of setups and series")]
fn whole(n: usize) -> f64 {
    n as f64
}
